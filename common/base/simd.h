// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

/// For kernels only: the one layer that knows processors (x86-64, ARM64). Kernels are written on vectors of
/// 16 bytes, which every processor has as registers, or of 32, which are registers where there is AVX2 and
/// pairs of them elsewhere. The arithmetic of the vectors is the compiler's (GCC vector extensions); what it
/// has no word for, or makes slow, is a function of simd_x86.h and simd_arm64.h. Both give the same bytes:
/// sums keep their lanes, and no product is fused with a sum (-ffp-contract=off).
///
/// Functions on 32 bytes carry CAIRN_WIDE, so do lambdas in them. No file is compiled with -mavx2, so no
/// inline function of a header can leak AVX code into a program that runs without it. A template without
/// CAIRN_WIDE may hold wide vectors only if it takes them by reference and is always inlined.
#define CAIRN_INLINE inline __attribute__((always_inline))
#if defined(__x86_64__)
#define CAIRN_WIDE __attribute__((target("avx2")))
/// What lies between these two may use AVX2: for sources that are included once for each instruction set. GCC
/// splits vectors wider than the target before it inlines, so templates shared by targets would lose them.
#ifdef __clang__
#define CAIRN_BEGIN_WIDE \
  _Pragma("clang attribute push(__attribute__((target(\"avx2\"))), apply_to = function)")
#define CAIRN_END_WIDE _Pragma("clang attribute pop")
#else
#define CAIRN_BEGIN_WIDE _Pragma("GCC push_options") _Pragma("GCC target(\"avx2\")")
#define CAIRN_END_WIDE _Pragma("GCC pop_options")
#endif
#elif defined(__aarch64__)
#define CAIRN_WIDE
#define CAIRN_BEGIN_WIDE
#define CAIRN_END_WIDE
#else
#error "common/base/simd.h knows x86-64 and ARM64"
#endif
// Wide vectors never cross the boundary of a function that is not inlined.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace cairn {

/// Variants of a kernel; all give the same bytes. kScalar is the reference that tests compare with.
enum class Simd { kScalar, kNarrow, kWide };

using U8x16 = uint8_t __attribute__((vector_size(16)));
using I16x8 = int16_t __attribute__((vector_size(16)));
using U16x8 = uint16_t __attribute__((vector_size(16)));
using I32x4 = int32_t __attribute__((vector_size(16)));
using U32x4 = uint32_t __attribute__((vector_size(16)));
using F32x4 = float __attribute__((vector_size(16)));
using F64x2 = double __attribute__((vector_size(16)));
using U8x32 = uint8_t __attribute__((vector_size(32)));
using I16x16 = int16_t __attribute__((vector_size(32)));
using U16x16 = uint16_t __attribute__((vector_size(32)));
using I32x8 = int32_t __attribute__((vector_size(32)));
using U32x8 = uint32_t __attribute__((vector_size(32)));
using F32x8 = float __attribute__((vector_size(32)));
using F64x4 = double __attribute__((vector_size(32)));

template <class V>
struct __attribute__((packed, may_alias)) UnalignedLanes {
  V lanes;
};

/// Loads a vector from memory that need not be aligned. The result comes by reference, see above. (memcpy
/// would be split into halves before a template gets to the function with the wide target.)
template <class V>
CAIRN_INLINE void load_lanes(const void* from, V* out) {
  *out = static_cast<const UnalignedLanes<V>*>(from)->lanes;
}
template <class V>
CAIRN_INLINE V load_lanes(const void* from) {
  return static_cast<const UnalignedLanes<V>*>(from)->lanes;
}
template <class V>
CAIRN_WIDE CAIRN_INLINE V load_wide(const void* from) {
  return static_cast<const UnalignedLanes<V>*>(from)->lanes;
}
template <class V>
CAIRN_INLINE void store_lanes(void* to, const V& v) {
  static_cast<UnalignedLanes<V>*>(to)->lanes = v;
}

/// Two lanes of floats or integers as the first two of the result, and so on.
#define CAIRN_LANES(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)

/// ((0+2)+(1+3)): the one order in which lanes are added up.
CAIRN_INLINE float sum_of_lanes(F32x4 v) {
  const F32x4 pairs = v + CAIRN_LANES(v, v, 2, 3, 2, 3);
  return pairs[0] + pairs[1];
}
CAIRN_INLINE int sum_of_lanes(I32x4 v) {
  const I32x4 pairs = v + CAIRN_LANES(v, v, 2, 3, 2, 3);
  return pairs[0] + pairs[1];
}

}  // namespace cairn

#if defined(__x86_64__)
#include "common/base/simd_x86.h"
#else
#include "common/base/simd_arm64.h"
#endif
