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

CAIRN_INLINE int zmssd_narrow(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  I32x4 squares{};
  I16x8 sums{};
#pragma GCC unroll 8
  for (int j = 0; j < kTemplateSize; ++j) {
    const I16x8 d =
        bytes_to_i16x8(patch.pixels.data() + j * kTemplateSize) - bytes_to_i16x8(window + j * stride);
    squares += multiply_add_pairs(d, d);
    sums += d;  // 8 rows of at most 255: fits
  }
  const I32x4 differences = multiply_add_pairs(sums, I16x8{} + 1);
  const I32x4 pairs =
      CAIRN_LANES(squares, differences, 0, 4, 1, 5) + CAIRN_LANES(squares, differences, 2, 6, 3, 7);
  const I32x4 both = pairs + CAIRN_LANES(pairs, pairs, 2, 3, 2, 3);
  return zmssd_of_sums(both[0], both[1]);
}

CAIRN_WIDE CAIRN_INLINE int zmssd_wide(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  I32x8 squares{};
  I16x16 sums{};
#pragma GCC unroll 4
  for (int j = 0; j < kTemplateSize; j += 2) {
    const I16x16 d = bytes_to_i16x16(patch.pixels.data() + j * kTemplateSize) -
                     bytes_to_i16x16(window + j * stride, window + (j + 1) * stride);
    squares += multiply_add_pairs(d, d);
    sums += d;
  }
  const I32x8 differences = multiply_add_pairs(sums, I16x16{} + 1);
  const I32x8 wide = CAIRN_LANES(squares, differences, 0, 8, 1, 9, 4, 12, 5, 13) +
                     CAIRN_LANES(squares, differences, 2, 10, 3, 11, 6, 14, 7, 15);
  const I32x4 pairs = lower_half(wide) + upper_half(wide);
  const I32x4 both = pairs + CAIRN_LANES(pairs, pairs, 2, 3, 2, 3);
  return zmssd_of_sums(both[0], both[1]);
}

CAIRN_WIDE int zmssd_wide_once(const PatchTemplate& patch, const uint8_t* window, ptrdiff_t stride) {
  return zmssd_wide(patch, window, stride);
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
  PatchMatch best;  ///< of corners examined so far; starts with the limit as its score

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

void search_narrow(CircleSearch* search) {
  const auto try_corner = [search](Corner c) {
    if (!search->is_window_inside(c)) return;
    search->offer(c, zmssd_narrow(search->patch, search->window(c), search->image.stride));
  };
  const Corner* group = search->begin;
  for (; search->end - group >= 4; group += 4) {
    const auto xy = load_lanes<I32x4>(group);
    const F32x4 dx = __builtin_convertvector(xy << 16 >> 16, F32x4) - search->center_x;
    const F32x4 dy = __builtin_convertvector(xy >> 16, F32x4) - search->center_y;
    uint32_t bits = lane_bits(dx * dx + dy * dy <= search->squared_radius);
    for (; bits != 0; bits &= bits - 1) try_corner(group[std::countr_zero(bits)]);
  }
  for (; group != search->end; ++group) {
    if (search->is_in_circle(*group)) try_corner(*group);
  }
}

CAIRN_WIDE void search_wide(CircleSearch* search) {
  const float center_x = search->center_x;
  const float center_y = search->center_y;
  const float squared_radius = search->squared_radius;
  for (const Corner* group = search->begin; group < search->end; group += 8) {
    const auto count = static_cast<int>(std::min<ptrdiff_t>(search->end - group, 8));
    const I32x8 xy = load_first(group, count);
    const F32x8 dx = __builtin_convertvector(xy << 16 >> 16, F32x8) - center_x;
    const F32x8 dy = __builtin_convertvector(xy >> 16, F32x8) - center_y;
    uint32_t bits = lane_bits(dx * dx + dy * dy <= squared_radius) & ((1U << count) - 1);
    for (; bits != 0; bits &= bits - 1) {
      const Corner c = group[std::countr_zero(bits)];
      if (!search->is_window_inside(c)) continue;
      search->offer(c, zmssd_wide(search->patch, search->window(c), search->image.stride));
    }
  }
}

}  // namespace

int kernels::zmssd_at(const PatchTemplate& patch, const GrayView& level_image, int x, int y, Simd simd) {
  const uint8_t* window = level_image.row(y - kHalf) + x - kHalf;
  switch (simd) {
    case Simd::kWide:
      return zmssd_wide_once(patch, window, level_image.stride);
    case Simd::kNarrow:
      return zmssd_narrow(patch, window, level_image.stride);
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
    case Simd::kWide:
      search_wide(&search);
      break;
    case Simd::kNarrow:
      search_narrow(&search);
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
