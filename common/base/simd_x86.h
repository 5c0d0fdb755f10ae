// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <immintrin.h>

/// Included by simd.h, which says what this is.
namespace cairn {

/// Whether this machine may be asked for kWide (SSE2, for kNarrow, is part of x86-64).
[[nodiscard]] inline bool has_wide() {
  static const bool has = __builtin_cpu_supports("avx2") != 0;
  return has;
}
[[nodiscard]] inline Simd best_simd() {
  return has_wide() ? Simd::kWide : Simd::kNarrow;
}
/// Whether a kernel that has only the scalar and the wide variant should run the wide one for `simd`.
[[nodiscard]] inline bool takes_wide(Simd simd) {
  return simd == Simd::kWide;
}

/// The nearest integer, halves to the even one.
CAIRN_INLINE int round_to_int(float value) {
  return _mm_cvtss_si32(_mm_set_ss(value));
}

/// Each lane into the next one: the first is 0, the last is gone.
CAIRN_INLINE I16x8 move_up(I16x8 v) {
  return (I16x8)_mm_slli_si128((__m128i)v, 2);
}

// ---- Halves of wide vectors

CAIRN_WIDE CAIRN_INLINE F32x4 lower_half(F32x8 v) {
  return _mm256_castps256_ps128(v);
}
CAIRN_WIDE CAIRN_INLINE F32x4 upper_half(F32x8 v) {
  return _mm256_extractf128_ps(v, 1);
}
CAIRN_WIDE CAIRN_INLINE I32x4 lower_half(I32x8 v) {
  return (I32x4)_mm256_castsi256_si128((__m256i)v);
}
CAIRN_WIDE CAIRN_INLINE I32x4 upper_half(I32x8 v) {
  return (I32x4)_mm256_extracti128_si256((__m256i)v, 1);
}
/// One half in both.
CAIRN_WIDE CAIRN_INLINE F64x4 lower_half_twice(F64x4 v) {
  return _mm256_permute2f128_pd(v, v, 0x00);
}
CAIRN_WIDE CAIRN_INLINE F64x4 upper_half_twice(F64x4 v) {
  return _mm256_permute2f128_pd(v, v, 0x11);
}

// ---- Wider lanes, from memory

CAIRN_INLINE I16x8 bytes_to_i16x8(const uint8_t* p) {
  return (I16x8)_mm_unpacklo_epi8(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)), _mm_setzero_si128());
}
CAIRN_WIDE CAIRN_INLINE I16x16 bytes_to_i16x16(const uint8_t* p) {
  return (I16x16)_mm256_cvtepu8_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
}
/// Eight from each.
CAIRN_WIDE CAIRN_INLINE I16x16 bytes_to_i16x16(const uint8_t* first, const uint8_t* second) {
  return (I16x16)_mm256_cvtepu8_epi16(
      _mm_unpacklo_epi64(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(first)),
                         _mm_loadl_epi64(reinterpret_cast<const __m128i*>(second))));
}
CAIRN_INLINE F32x4 bytes_to_f32x4(const uint8_t* p) {
  int32_t bytes = 0;
  __builtin_memcpy(&bytes, p, sizeof(bytes));
  const __m128i zero = _mm_setzero_si128();
  return _mm_cvtepi32_ps(_mm_unpacklo_epi16(_mm_unpacklo_epi8(_mm_cvtsi32_si128(bytes), zero), zero));
}
CAIRN_WIDE CAIRN_INLINE F32x8 bytes_to_f32x8(const uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p))));
}
CAIRN_INLINE F32x4 words_to_f32x4(const int16_t* p) {
  const __m128i words = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(p));
  return _mm_cvtepi32_ps(_mm_unpacklo_epi16(words, _mm_srai_epi16(words, 15)));
}
CAIRN_WIDE CAIRN_INLINE F32x8 words_to_f32x8(const int16_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p))));
}
CAIRN_WIDE CAIRN_INLINE I32x8 words_to_i32x8(const uint16_t* p) {
  return (I32x8)_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
}

// ---- Other ways to memory and back

/// Lanes that fit a byte.
CAIRN_INLINE void store_as_bytes(uint8_t* to, I16x8 v) {
  _mm_storel_epi64(reinterpret_cast<__m128i*>(to), _mm_packus_epi16((__m128i)v, (__m128i)v));
}
CAIRN_WIDE CAIRN_INLINE void store_as_bytes(uint8_t* to, I32x8 v) {
  const __m128i words =
      _mm_packus_epi32(_mm256_castsi256_si128((__m256i)v), _mm256_extracti128_si256((__m256i)v, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(to), _mm_packus_epi16(words, words));
}
CAIRN_INLINE void store_as_bytes(uint8_t* to, U16x8 first, U16x8 second) {
  store_lanes(to, _mm_packus_epi16((__m128i)first, (__m128i)second));
}
CAIRN_WIDE CAIRN_INLINE void store_as_bytes(uint8_t* to, U16x16 first, U16x16 second) {
  const __m256i packed = _mm256_packus_epi16((__m256i)first, (__m256i)second);
  store_lanes(to, _mm256_permute4x64_epi64(packed, 0b11'01'10'00));
}
/// The same sixteen bytes in both halves.
CAIRN_WIDE CAIRN_INLINE U8x32 load_twice(const uint8_t* from) {
  return (U8x32)_mm256_broadcastsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(from)));
}
CAIRN_WIDE CAIRN_INLINE F64x4 load_twice(const double* from) {
  return _mm256_broadcast_pd(reinterpret_cast<const __m128d*>(from));
}
/// Two from each.
CAIRN_INLINE F32x4 load_pairs(const float* first, const float* second) {
  const __m128 low = _mm_loadl_pi(_mm_setzero_ps(), reinterpret_cast<const __m64*>(first));
  return _mm_loadh_pi(low, reinterpret_cast<const __m64*>(second));
}
/// The first `count` lanes; nothing is read beyond them, the rest are 0.
CAIRN_WIDE CAIRN_INLINE I32x8 load_first(const void* from, int count) {
  const I32x8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
  return (I32x8)_mm256_maskload_epi32(static_cast<const int*>(from), (__m256i)(lane < count));
}
/// Lane i: the four bytes at `from` + kScale * index[i].
template <int kScale>
CAIRN_WIDE CAIRN_INLINE I32x8 gather(const uint8_t* from, I32x8 index) {
  return (I32x8)_mm256_i32gather_epi32(reinterpret_cast<const int*>(from), (__m256i)index, kScale);
}
/// Lane i of each half: the byte of the same half of `table` that `which` says (below 16), or 0 for 255.
CAIRN_WIDE CAIRN_INLINE U8x32 pick_bytes(U8x32 table, U8x32 which) {
  return (U8x32)_mm256_shuffle_epi8((__m256i)table, (__m256i)which);
}

// ---- Arithmetic

/// a < b ? a : b, and the other.
CAIRN_INLINE F32x4 smaller(F32x4 a, F32x4 b) {
  return _mm_min_ps(a, b);
}
CAIRN_WIDE CAIRN_INLINE I32x8 smaller(I32x8 a, I32x8 b) {
  return (I32x8)_mm256_min_epi32((__m256i)a, (__m256i)b);
}
CAIRN_WIDE CAIRN_INLINE I32x8 larger(I32x8 a, I32x8 b) {
  return (I32x8)_mm256_max_epi32((__m256i)a, (__m256i)b);
}

/// Lane i: bytes 2i and 2i + 1.
CAIRN_INLINE U16x8 sums_of_pairs(U8x16 bytes) {
  return ((U16x8)bytes & 0x00FF) + ((U16x8)bytes >> 8);
}
CAIRN_WIDE CAIRN_INLINE U16x16 sums_of_pairs(U8x32 bytes) {
  return (U16x16)_mm256_maddubs_epi16((__m256i)bytes, _mm256_set1_epi8(1));
}

/// Lane i: a[2i] * b[2i] + a[2i + 1] * b[2i + 1].
CAIRN_INLINE I32x4 multiply_add_pairs(I16x8 a, I16x8 b) {
  return (I32x4)_mm_madd_epi16((__m128i)a, (__m128i)b);
}
CAIRN_WIDE CAIRN_INLINE I32x8 multiply_add_pairs(I16x16 a, I16x16 b) {
  return (I32x8)_mm256_madd_epi16((__m256i)a, (__m256i)b);
}

/// Bit i is set where lane i has its top bit set: for results of comparisons.
CAIRN_INLINE uint32_t lane_bits(I32x4 mask) {
  return static_cast<uint32_t>(_mm_movemask_ps((__m128)mask));
}
CAIRN_WIDE CAIRN_INLINE uint32_t lane_bits(I32x8 mask) {
  return static_cast<uint32_t>(_mm256_movemask_ps((__m256)mask));
}
/// The same for vectors of bytes of either width, also in templates.
template <class V>
CAIRN_INLINE uint32_t byte_lane_bits(const V& mask) {
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

// ---- Bits of 256 that differ: by population count of whole vectors, of words, or as the compiler makes it

#define CAIRN_COUNT_WORDS __attribute__((target("popcnt")))
#define CAIRN_COUNT_VECTORS __attribute__((target("avx512vl,avx512vpopcntdq")))

[[nodiscard]] inline bool can_count_words() {
  static const bool can = __builtin_cpu_supports("popcnt") != 0;
  return can;
}
[[nodiscard]] inline bool can_count_vectors() {
  static const bool can =
      __builtin_cpu_supports("avx512vl") != 0 && __builtin_cpu_supports("avx512vpopcntdq") != 0;
  return can;
}

CAIRN_COUNT_WORDS inline int different_bits_by_words(const uint64_t* a, const uint64_t* b) {
  return __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
         __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]);
}
CAIRN_COUNT_VECTORS inline int different_bits_by_vectors(const uint64_t* a, const uint64_t* b) {
  const __m256i one = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(a));
  const __m256i other = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(b));
  const __m256i counts = _mm256_popcnt_epi64(_mm256_xor_si256(one, other));
  const __m128i sums = _mm_add_epi64(_mm256_castsi256_si128(counts), _mm256_extracti128_si256(counts, 1));
  return _mm_cvtsi128_si32(_mm_add_epi64(sums, _mm_unpackhi_epi64(sums, sums)));
}

}  // namespace cairn
