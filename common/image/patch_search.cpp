// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <cmath>

#include "common/image/kernels.h"

namespace cairn {
namespace {

constexpr int kHalf = kTemplateSize / 2;
constexpr int kPixels = kTemplateSize * kTemplateSize;

/// sum((a-b)^2) - (sum(a)-sum(b))^2 / 64, rounded down; exact integers, never negative (Cauchy-Schwarz).
CAIRN_INLINE int zmssd_of_sums(int sum_squared_differences, int sum_differences) {
  return (sum_squared_differences * kPixels - sum_differences * sum_differences) >> 6;
}

int zmssd_scalar(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  int squares = 0;
  int sum = 0;
  for (int j = 0; j < kTemplateSize; ++j) {
    for (int i = 0; i < kTemplateSize; ++i) {
      const int d = patch.pixels[static_cast<size_t>(j) * kTemplateSize + static_cast<size_t>(i)] -
                    window[j * stride + i];
      squares += d * d;
      sum += d;
    }
  }
  return zmssd_of_sums(squares, sum);
}

CAIRN_INLINE int zmssd_sse2(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  const __m128i zero = _mm_setzero_si128();
  __m128i squares = zero;
  __m128i sums = zero;
#pragma GCC unroll 8
  for (int j = 0; j < kTemplateSize; ++j) {
    const __m128i a =
        _mm_unpacklo_epi8(_mm_loadl_epi64(vector_at(patch.pixels.data() + j * kTemplateSize)), zero);
    const __m128i b = _mm_unpacklo_epi8(_mm_loadl_epi64(vector_at(window + j * stride)), zero);
    const __m128i d = _mm_sub_epi16(a, b);
    squares = _mm_add_epi32(squares, _mm_madd_epi16(d, d));
    sums = _mm_add_epi16(sums, d);  // 8 rows of at most 255: fits
  }
  sums = _mm_madd_epi16(sums, _mm_set1_epi16(1));
  const __m128i pairs = _mm_add_epi32(_mm_unpacklo_epi32(squares, sums), _mm_unpackhi_epi32(squares, sums));
  const __m128i both = _mm_add_epi32(pairs, _mm_unpackhi_epi64(pairs, pairs));
  return zmssd_of_sums(_mm_cvtsi128_si32(both), _mm_cvtsi128_si32(_mm_srli_si128(both, 4)));
}

CAIRN_AVX2 CAIRN_INLINE int zmssd_avx2(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  __m256i squares = _mm256_setzero_si256();
  __m256i sums = _mm256_setzero_si256();
#pragma GCC unroll 4
  for (int j = 0; j < kTemplateSize; j += 2) {
    const __m256i a =
        _mm256_cvtepu8_epi16(_mm_load_si128(vector_at(patch.pixels.data() + j * kTemplateSize)));
    const __m128i top = _mm_loadl_epi64(vector_at(window + j * stride));
    const __m128i bottom = _mm_loadl_epi64(vector_at(window + (j + 1) * stride));
    const __m256i d = _mm256_sub_epi16(a, _mm256_cvtepu8_epi16(_mm_unpacklo_epi64(top, bottom)));
    squares = _mm256_add_epi32(squares, _mm256_madd_epi16(d, d));
    sums = _mm256_add_epi16(sums, d);
  }
  sums = _mm256_madd_epi16(sums, _mm256_set1_epi16(1));
  const __m256i wide =
      _mm256_add_epi32(_mm256_unpacklo_epi32(squares, sums), _mm256_unpackhi_epi32(squares, sums));
  const __m128i pairs = _mm_add_epi32(_mm256_castsi256_si128(wide), _mm256_extracti128_si256(wide, 1));
  const __m128i both = _mm_add_epi32(pairs, _mm_unpackhi_epi64(pairs, pairs));
  return zmssd_of_sums(_mm_cvtsi128_si32(both), _mm_extract_epi32(both, 1));
}

CAIRN_AVX2 int zmssd_avx2_once(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  return zmssd_avx2(patch, window, stride);
}

/// Corners of all rows that the circle touches, and what decides which of them to try. The corners of a band
/// of rows lie one after the other in memory: testing all of them, several at a time, beats finding the right
/// ones row by row.
struct CircleSearch {
  const PatchTemplate& patch;
  const GrayView& image;
  const Corner* begin;
  const Corner* end;
  float center_x;
  float center_y;
  float squared_radius;
  PatchMatch best;  ///< of corners tried so far; starts with the limit as its score

  [[nodiscard]] bool is_window_inside(Corner c) const { return c.x >= kHalf && c.x <= image.width - kHalf; }
  [[nodiscard]] const uint8_t* window(Corner c) const { return image.row(c.y - kHalf) + c.x - kHalf; }
  /// Strictly better only: ties go to the first in row-major order, in every variant.
  void offer(Corner c, int score) {
    if (score < best.zmssd) best = {c, score};
  }
  [[nodiscard]] bool is_in_circle(Corner c) const {
    const float dx = static_cast<float>(c.x) - center_x;
    const float dy = static_cast<float>(c.y) - center_y;
    return dx * dx + dy * dy <= squared_radius;
  }
};

void search_scalar(CircleSearch* search) {
  for (const Corner* c = search->begin; c != search->end; ++c) {
    if (!search->is_in_circle(*c) || !search->is_window_inside(*c)) continue;
    search->offer(*c, zmssd_scalar(search->patch, search->window(*c), search->image.stride));
  }
}

void search_sse2(CircleSearch* search) {
  const __m128 center_x = _mm_set1_ps(search->center_x);
  const __m128 center_y = _mm_set1_ps(search->center_y);
  const __m128 squared_radius = _mm_set1_ps(search->squared_radius);
  const auto try_corner = [search](Corner c) {
    if (!search->is_window_inside(c)) return;
    search->offer(c, zmssd_sse2(search->patch, search->window(c), search->image.stride));
  };
  const Corner* group = search->begin;
  for (; search->end - group >= 4; group += 4) {
    const __m128i xy = _mm_loadu_si128(reinterpret_cast<const __m128i*>(group));
    const __m128 dx = _mm_sub_ps(_mm_cvtepi32_ps(_mm_srai_epi32(_mm_slli_epi32(xy, 16), 16)), center_x);
    const __m128 dy = _mm_sub_ps(_mm_cvtepi32_ps(_mm_srai_epi32(xy, 16)), center_y);
    const __m128 squared_distance = _mm_add_ps(_mm_mul_ps(dx, dx), _mm_mul_ps(dy, dy));
    auto bits = static_cast<uint32_t>(_mm_movemask_ps(_mm_cmple_ps(squared_distance, squared_radius)));
    for (; bits != 0; bits &= bits - 1) try_corner(group[std::countr_zero(bits)]);
  }
  for (; group != search->end; ++group) {
    if (search->is_in_circle(*group)) try_corner(*group);
  }
}

CAIRN_AVX2 void search_avx2(CircleSearch* search) {
  const __m256 center_x = _mm256_set1_ps(search->center_x);
  const __m256 center_y = _mm256_set1_ps(search->center_y);
  const __m256 squared_radius = _mm256_set1_ps(search->squared_radius);
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  for (const Corner* group = search->begin; group < search->end; group += 8) {
    const __m256i exists = _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(search->end - group)), lane);
    const __m256i xy = _mm256_maskload_epi32(reinterpret_cast<const int*>(group), exists);
    const __m256 dx =
        _mm256_sub_ps(_mm256_cvtepi32_ps(_mm256_srai_epi32(_mm256_slli_epi32(xy, 16), 16)), center_x);
    const __m256 dy = _mm256_sub_ps(_mm256_cvtepi32_ps(_mm256_srai_epi32(xy, 16)), center_y);
    const __m256 squared_distance = _mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy));
    const __m256 inside = _mm256_and_ps(_mm256_cmp_ps(squared_distance, squared_radius, _CMP_LE_OQ),
                                        _mm256_castsi256_ps(exists));
    for (auto bits = static_cast<uint32_t>(_mm256_movemask_ps(inside)); bits != 0; bits &= bits - 1) {
      const Corner c = group[std::countr_zero(bits)];
      if (!search->is_window_inside(c)) continue;
      search->offer(c, zmssd_avx2(search->patch, search->window(c), search->image.stride));
    }
  }
}

}  // namespace

int kernels::zmssd_at(const PatchTemplate& patch, const GrayView& level_image, int x, int y, Simd simd) {
  const uint8_t* window = level_image.row(y - kHalf) + x - kHalf;
  switch (simd) {
    case Simd::kAvx2:
      return zmssd_avx2_once(patch, window, level_image.stride);
    case Simd::kSse2:
      return zmssd_sse2(patch, window, level_image.stride);
    case Simd::kScalar:
      break;
  }
  return zmssd_scalar(patch, window, level_image.stride);
}

int zmssd_at(const PatchTemplate& patch, const GrayView& level_image, int x, int y) {
  return kernels::zmssd_at(patch, level_image, x, y, best_simd());
}

std::optional<PatchMatch> kernels::find_patch(const PatchTemplate& patch, const GrayView& level_image,
                                              const CornerList& corners, const Eigen::Vector2f& center,
                                              float radius, int max_zmssd, Simd simd) {
  const auto lowest = static_cast<float>(kHalf);
  const auto highest = static_cast<float>(
      std::min(level_image.height - kHalf, static_cast<int>(corners.row_begin.size()) - 2));
  const float first_y = std::ceil(std::max(center.y() - radius, lowest));
  const float last_y = std::floor(std::min(center.y() + radius, highest));
  if (!(first_y <= last_y)) return std::nullopt;
  const Corner* all = corners.corners.data();
  CircleSearch search{.patch = patch,
                      .image = level_image,
                      .begin = all + corners.row_begin[static_cast<size_t>(first_y)],
                      .end = all + corners.row_begin[static_cast<size_t>(last_y) + 1],
                      .center_x = center.x(),
                      .center_y = center.y(),
                      .squared_radius = radius * radius,
                      .best = {.corner = {}, .zmssd = max_zmssd}};
  switch (simd) {
    case Simd::kAvx2:
      search_avx2(&search);
      break;
    case Simd::kSse2:
      search_sse2(&search);
      break;
    case Simd::kScalar:
      search_scalar(&search);
      break;
  }
  if (search.best.zmssd >= max_zmssd) return std::nullopt;
  return search.best;
}

std::optional<PatchMatch> find_patch(const PatchTemplate& patch, const GrayView& level_image,
                                     const CornerList& corners, const Eigen::Vector2f& center, float radius,
                                     int max_zmssd) {
  return kernels::find_patch(patch, level_image, corners, center, radius, max_zmssd, best_simd());
}

}  // namespace cairn
