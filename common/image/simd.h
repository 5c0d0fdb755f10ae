// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <immintrin.h>

#include <cstdint>
#include <cstring>

/// For kernels only: run-time dispatch and lanes of bytes.
///
/// Kernels that need nothing but byte arithmetic are written once, as always_inline templates over the vector
/// type (GCC vector extensions), and instantiated in thin functions that carry the target attribute. No file
/// is compiled with -mavx2, so no inline function of a header can leak AVX code into a program that runs
/// without it.
#define CAIRN_AVX2 __attribute__((target("avx2")))
#define CAIRN_INLINE inline __attribute__((always_inline))

namespace cairn {

/// Variants of a kernel; all give the same bytes. kScalar is the reference that tests compare with.
enum class Simd { kScalar, kSse2, kAvx2 };

/// The best variant of this machine (SSE2 is part of x86-64).
[[nodiscard]] inline Simd best_simd() {
  static const Simd best = __builtin_cpu_supports("avx2") ? Simd::kAvx2 : Simd::kSse2;
  return best;
}

CAIRN_INLINE const __m128i* vector_at(const uint8_t* p) {
  return reinterpret_cast<const __m128i*>(p);
}

using Bytes16 = uint8_t __attribute__((vector_size(16)));
using Bytes32 = uint8_t __attribute__((vector_size(32)));

// Vectors go by reference: by value they would cross the boundary between code with and without AVX
// (-Wpsabi).

/// Unaligned loads. (memcpy would be split into halves before the template gets to the function with the wide
/// target.)
CAIRN_INLINE void load_bytes(const uint8_t* p, Bytes16* out) {
  using Unaligned = uint8_t __attribute__((vector_size(16), aligned(1), may_alias));
  *out = *reinterpret_cast<const Unaligned*>(p);
}
CAIRN_INLINE void load_bytes(const uint8_t* p, Bytes32* out) {
  using Unaligned = uint8_t __attribute__((vector_size(32), aligned(1), may_alias));
  *out = *reinterpret_cast<const Unaligned*>(p);
}

template <class V>
CAIRN_INLINE void splat_bytes(int value, V* out) {
  std::memset(out, value, sizeof(V));
}

/// Bit i is set where lane i has its top bit set: for results of comparisons.
template <class V>
CAIRN_INLINE uint32_t lane_bits(const V& mask) {
#ifdef __clang__
  // Which takes the builtins in the targeted function only.
  uint32_t bits = 0;
  for (size_t lane = 0; lane < sizeof(V); ++lane) bits |= uint32_t{mask[lane]} >> 7 << lane;
  return bits;
#else
  // The builtins, not the intrinsics: an intrinsic of a wider target cannot be inlined into a template, only
  // into the targeted function that the template ends up in.
  if constexpr (sizeof(V) == 32) {
    using Chars = char __attribute__((vector_size(32)));
    return static_cast<uint32_t>(__builtin_ia32_pmovmskb256(reinterpret_cast<const Chars&>(mask)));
  } else {
    using Chars = char __attribute__((vector_size(16)));
    return static_cast<uint32_t>(__builtin_ia32_pmovmskb128(reinterpret_cast<const Chars&>(mask)));
  }
#endif
}

}  // namespace cairn
