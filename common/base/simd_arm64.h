// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arm_neon.h>

/// Included by simd.h, which says what this is; the functions are those of simd_x86.h, where each is
/// explained.
namespace cairn {

[[nodiscard]] inline bool has_wide() {
  return true;
}
/// A vector of 32 bytes is two registers, which the compiler keeps in memory now and then.
[[nodiscard]] inline Simd best_simd() {
  return Simd::kNarrow;
}
[[nodiscard]] inline bool takes_wide(Simd simd) {
  return simd != Simd::kScalar;
}

CAIRN_INLINE int round_to_int(float value) {
  return vcvtns_s32_f32(value);
}

/// Each lane into the next one: the first is 0, the last is gone.
CAIRN_INLINE I16x8 move_up(I16x8 v) {
  return CAIRN_LANES(I16x8{}, v, 0, 8, 9, 10, 11, 12, 13, 14);
}

// ---- Halves of wide vectors

CAIRN_INLINE I16x8 lower_half(I16x16 v) {
  return CAIRN_LANES(v, v, 0, 1, 2, 3, 4, 5, 6, 7);
}
CAIRN_INLINE I16x8 upper_half(I16x16 v) {
  return CAIRN_LANES(v, v, 8, 9, 10, 11, 12, 13, 14, 15);
}
CAIRN_INLINE I32x4 lower_half(I32x8 v) {
  return CAIRN_LANES(v, v, 0, 1, 2, 3);
}
CAIRN_INLINE I32x4 upper_half(I32x8 v) {
  return CAIRN_LANES(v, v, 4, 5, 6, 7);
}
CAIRN_INLINE F32x4 lower_half(F32x8 v) {
  return CAIRN_LANES(v, v, 0, 1, 2, 3);
}
CAIRN_INLINE F32x4 upper_half(F32x8 v) {
  return CAIRN_LANES(v, v, 4, 5, 6, 7);
}
CAIRN_INLINE F64x4 lower_half_twice(F64x4 v) {
  return CAIRN_LANES(v, v, 0, 1, 0, 1);
}
CAIRN_INLINE F64x4 upper_half_twice(F64x4 v) {
  return CAIRN_LANES(v, v, 2, 3, 2, 3);
}
CAIRN_INLINE U8x16 lower_half(U8x32 v) {
  return load_lanes<U8x16>(&v);
}
CAIRN_INLINE U8x16 upper_half(U8x32 v) {
  return load_lanes<U8x16>(reinterpret_cast<const uint8_t*>(&v) + 16);
}

template <class Wide, class V>
CAIRN_INLINE Wide join(const V& lower, const V& upper) {
  static_assert(sizeof(Wide) == 2 * sizeof(V));
  Wide v;
  store_lanes(&v, lower);
  store_lanes(reinterpret_cast<uint8_t*>(&v) + sizeof(V), upper);
  return v;
}

// ---- Wider lanes, from memory

CAIRN_INLINE I16x8 bytes_to_i16x8(const uint8_t* p) {
  return (I16x8)vmovl_u8(vld1_u8(p));
}
CAIRN_INLINE I16x16 bytes_to_i16x16(const uint8_t* first, const uint8_t* second) {
  return join<I16x16>(bytes_to_i16x8(first), bytes_to_i16x8(second));
}
CAIRN_INLINE I16x16 bytes_to_i16x16(const uint8_t* p) {
  return bytes_to_i16x16(p, p + 8);
}
CAIRN_INLINE F32x4 bytes_to_f32x4(const uint8_t* p) {
  uint32_t bytes = 0;
  __builtin_memcpy(&bytes, p, sizeof(bytes));
  return vcvtq_f32_u32(vmovl_u16(vget_low_u16(vmovl_u8(vcreate_u8(bytes)))));
}
CAIRN_INLINE F32x8 bytes_to_f32x8(const uint8_t* p) {
  const uint16x8_t words = vmovl_u8(vld1_u8(p));
  return join<F32x8>(vcvtq_f32_u32(vmovl_u16(vget_low_u16(words))), vcvtq_f32_u32(vmovl_high_u16(words)));
}
CAIRN_INLINE F32x4 words_to_f32x4(const int16_t* p) {
  return vcvtq_f32_s32(vmovl_s16(vld1_s16(p)));
}
CAIRN_INLINE F32x8 words_to_f32x8(const int16_t* p) {
  return join<F32x8>(words_to_f32x4(p), words_to_f32x4(p + 4));
}
CAIRN_INLINE I32x8 words_to_i32x8(const uint16_t* p) {
  return join<I32x8>(vmovl_u16(vld1_u16(p)), vmovl_u16(vld1_u16(p + 4)));
}

// ---- Other ways to memory and back

CAIRN_INLINE void store_as_bytes(uint8_t* to, I16x8 v) {
  vst1_u8(to, vmovn_u16((uint16x8_t)v));
}
CAIRN_INLINE void store_as_bytes(uint8_t* to, I32x8 v) {
  const uint16x4_t lower = vmovn_u32((uint32x4_t)lower_half(v));
  vst1_u8(to, vmovn_u16(vmovn_high_u32(lower, (uint32x4_t)upper_half(v))));
}
CAIRN_INLINE void store_as_bytes(uint8_t* to, U16x8 first, U16x8 second) {
  vst1q_u8(to, vmovn_high_u16(vmovn_u16(first), second));
}
CAIRN_INLINE void store_as_bytes(uint8_t* to, U16x16 first, U16x16 second) {
  store_as_bytes(to, CAIRN_LANES(first, first, 0, 1, 2, 3, 4, 5, 6, 7),
                 CAIRN_LANES(first, first, 8, 9, 10, 11, 12, 13, 14, 15));
  store_as_bytes(to + 16, CAIRN_LANES(second, second, 0, 1, 2, 3, 4, 5, 6, 7),
                 CAIRN_LANES(second, second, 8, 9, 10, 11, 12, 13, 14, 15));
}
CAIRN_INLINE U8x32 load_twice(const uint8_t* from) {
  const auto bytes = load_lanes<U8x16>(from);
  return join<U8x32>(bytes, bytes);
}
CAIRN_INLINE F64x4 load_twice(const double* from) {
  const auto two = load_lanes<F64x2>(from);
  return join<F64x4>(two, two);
}
CAIRN_INLINE F32x4 load_pairs(const float* first, const float* second) {
  return vcombine_f32(vld1_f32(first), vld1_f32(second));
}
CAIRN_INLINE I32x8 load_first(const void* from, int count) {
  I32x8 v = {};
  __builtin_memcpy(&v, from, sizeof(int32_t) * static_cast<size_t>(count < 8 ? count : 8));
  return v;
}
template <int kScale>
CAIRN_INLINE I32x8 gather(const uint8_t* from, I32x8 index) {
  I32x8 v = {};
  for (int lane = 0; lane < 8; ++lane) {
    int32_t bytes = 0;
    __builtin_memcpy(&bytes, from + kScale * index[lane], sizeof(bytes));
    v[lane] = bytes;
  }
  return v;
}
CAIRN_INLINE U8x32 pick_bytes(U8x32 table, U8x32 which) {
  return join<U8x32>(vqtbl1q_u8(lower_half(table), lower_half(which)),
                     vqtbl1q_u8(upper_half(table), upper_half(which)));
}

// ---- Arithmetic

CAIRN_INLINE F32x4 smaller(F32x4 a, F32x4 b) {
  return vbslq_f32(vcltq_f32(a, b), a, b);
}
CAIRN_INLINE I32x8 smaller(I32x8 a, I32x8 b) {
  return join<I32x8>(vminq_s32(lower_half(a), lower_half(b)), vminq_s32(upper_half(a), upper_half(b)));
}
CAIRN_INLINE I32x8 larger(I32x8 a, I32x8 b) {
  return join<I32x8>(vmaxq_s32(lower_half(a), lower_half(b)), vmaxq_s32(upper_half(a), upper_half(b)));
}
CAIRN_INLINE U16x8 sums_of_pairs(U8x16 bytes) {
  return vpaddlq_u8(bytes);
}
CAIRN_INLINE U16x16 sums_of_pairs(U8x32 bytes) {
  return join<U16x16>(vpaddlq_u8(lower_half(bytes)), vpaddlq_u8(upper_half(bytes)));
}

CAIRN_INLINE I32x4 multiply_add_pairs(I16x8 a, I16x8 b) {
  return vpaddq_s32(vmull_s16(vget_low_s16(a), vget_low_s16(b)), vmull_high_s16(a, b));
}
CAIRN_INLINE I32x8 multiply_add_pairs(I16x16 a, I16x16 b) {
  return join<I32x8>(multiply_add_pairs(lower_half(a), lower_half(b)),
                     multiply_add_pairs(upper_half(a), upper_half(b)));
}

CAIRN_INLINE uint32_t lane_bits(I32x4 mask) {
  const uint32x4_t weights = {1, 2, 4, 8};
  return vaddvq_u32(vandq_u32((uint32x4_t)vshrq_n_s32(mask, 31), weights));
}
CAIRN_INLINE uint32_t lane_bits(I32x8 mask) {
  return lane_bits(lower_half(mask)) | lane_bits(upper_half(mask)) << 4;
}
CAIRN_INLINE uint32_t byte_lane_bits(const U8x16& mask) {
  const uint8x16_t weights = {1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128};
  const uint8x16_t bits = vandq_u8((uint8x16_t)vshrq_n_s8((int8x16_t)mask, 7), weights);
  return vaddv_u8(vget_low_u8(bits)) | uint32_t{vaddv_u8(vget_high_u8(bits))} << 8;
}
CAIRN_INLINE uint32_t byte_lane_bits(const U8x32& mask) {
  return byte_lane_bits(lower_half(mask)) | byte_lane_bits(upper_half(mask)) << 16;
}

// ---- Bits of 256 that differ

#define CAIRN_COUNT_WORDS
#define CAIRN_COUNT_VECTORS

[[nodiscard]] inline bool can_count_words() {
  return true;
}
[[nodiscard]] inline bool can_count_vectors() {
  return true;
}

CAIRN_INLINE int different_bits_by_words(const uint64_t* a, const uint64_t* b) {
  return __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
         __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]);
}
CAIRN_INLINE int different_bits_by_vectors(const uint64_t* a, const uint64_t* b) {
  const auto counts = [&](size_t word) {
    return vcntq_u8(load_lanes<U8x16>(a + word) ^ load_lanes<U8x16>(b + word));
  };
  return vaddlvq_u8(vaddq_u8(counts(0), counts(2)));
}

}  // namespace cairn
