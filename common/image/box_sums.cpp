// SPDX-License-Identifier: Apache-2.0
#include "common/image/box_sums.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "common/image/kernels.h"

namespace cairn {
namespace {

constexpr int kHalf = kTemplateSize / 2;
constexpr int kPixels = kTemplateSize * kTemplateSize;
constexpr int kLanes = 8;         ///< positions at a time
constexpr int kBytesLoaded = 16;  ///< of an image row for so many positions

/// out[x] = the sum of eight values from x on.
template <class From, class To>
void sum_eight(const std::vector<From>& values, size_t count, To* out) {
  for (size_t x = 0; x < count; ++x) {
    const From* v = &values[x];
    out[x] = static_cast<To>(v[0] + v[1] + v[2] + v[3] + v[4] + v[5] + v[6] + v[7]);
  }
}

/// Collects the matches of a search, and lowers the limit below which the next one must be.
struct ZmssdMatches {
  float ratio;
  int limit;
  std::vector<PatchMatch>* out;

  void add(int x, int y, int score) {
    out->push_back({{static_cast<int16_t>(x), static_cast<int16_t>(y)}, score});
    const double lower = std::ceil(score / static_cast<double>(ratio));
    if (lower < limit) limit = static_cast<int>(lower);
  }
};

void find_one_by_one(const PatchTemplate& patch, const GrayView& image, std::span<const PixelRun> runs,
                     Simd simd, ZmssdMatches* matches) {
  for (const PixelRun& run : runs) {
    for (int x = run.first; x <= run.last; ++x) {
      const int score = kernels::zmssd_at(patch, image, x, run.row, simd);
      if (score < matches->limit) matches->add(x, run.row, score);
    }
  }
}

/// Two pixels of a template as a factor for multiply_add_pairs().
using Pairs = std::array<int32_t, kPixels / 2>;

CAIRN_WIDE CAIRN_INLINE void widen(const PatchTemplate& patch, Pairs* out) {
  for (size_t i = 0; i < kTemplatePixels; i += kBytesLoaded)
    store_lanes(&(*out)[i / 2], bytes_to_i16x16(&patch.pixels[i]));
}

/// Lane i: the sum of the products of the template with the window whose upper left pixel is `window` + i.
CAIRN_WIDE CAIRN_INLINE I32x8 products(const Pairs& pairs, const uint8_t* window, ptrdiff_t stride) {
  // Bytes (i, i + 1) of a row as 16 bits each, for lane i; 2, 4 and 6 bytes farther on for the other pairs.
  constexpr uint8_t kNone = 255;
  const U8x32 first = {0, kNone, 1, kNone, 1, kNone, 2, kNone, 2, kNone, 3, kNone, 3, kNone, 4, kNone,
                       4, kNone, 5, kNone, 5, kNone, 6, kNone, 6, kNone, 7, kNone, 7, kNone, 8, kNone};
  const U8x32 two = {2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0,  //
                     2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0};
  const U8x32 second = first + two;
  const U8x32 third = second + two;
  const U8x32 fourth = third + two;
  I32x8 even{};
  I32x8 odd{};
#pragma GCC unroll 8
  for (size_t j = 0; j < kTemplateSize; ++j) {
    const U8x32 row = load_twice(window + static_cast<ptrdiff_t>(j) * stride);
    const int32_t* pair = &pairs[j * kTemplateSize / 2];
    const auto times = [&](const U8x32& bytes, int32_t by) CAIRN_WIDE {
      return multiply_add_pairs((I16x16)pick_bytes(row, bytes), (I16x16)(I32x8{} + by));
    };
    even += times(first, pair[0]);
    odd += times(second, pair[1]);
    even += times(third, pair[2]);
    odd += times(fourth, pair[3]);
  }
  return even + odd;
}

/// The exact value rounded down, as zmssd_at() has it.
CAIRN_WIDE CAIRN_INLINE I32x8 scores(const PatchTemplate& patch, const Pairs& pairs, const GrayView& image,
                                     const BoxSums& sums, int left, int top) {
  const I32x8 p = products(pairs, image.row(top) + left, image.stride);
  const I32x8 d = patch.sum - words_to_i32x8(sums.sums(left, top));
  const I32x8 squares = patch.sum_squares + load_wide<I32x8>(sums.squares(left, top)) - (p << 1);
  return ((squares << 6) - d * d) >> 6;
}

CAIRN_WIDE void find_wide(const PatchTemplate& patch, const GrayView& image, const BoxSums& sums,
                          std::span<const PixelRun> runs, ZmssdMatches* matches) {
  alignas(32) Pairs pairs;
  widen(patch, &pairs);
  alignas(32) std::array<int, kLanes> eight;
  for (const PixelRun& run : runs) {
    for (int x = run.first; x <= run.last;) {
      // Near the image's right end the first lanes are of windows that are not asked for.
      const int left = std::min(x - kHalf, image.width - kBytesLoaded);
      const int skipped = x - kHalf - left;
      if (skipped == kLanes) {  // the last window of the row
        find_one_by_one(patch, image, {{{run.row, x, x}}}, Simd::kWide, matches);
        break;
      }
      const int wanted = std::min(run.last - x + 1, kLanes - skipped);
      const I32x8 all = scores(patch, pairs, image, sums, left, run.row - kHalf);
      uint32_t bits = lane_bits(all < matches->limit) >> skipped;
      bits &= (1U << wanted) - 1;
      if (bits != 0) store_lanes(eight.data(), all);
      for (; bits != 0; bits &= bits - 1) {
        const int lane = std::countr_zero(bits);
        const int score = eight[static_cast<size_t>(skipped + lane)];
        if (score < matches->limit) matches->add(x + lane, run.row, score);
      }
      x += wanted;
    }
  }
}

}  // namespace

BoxSums::BoxSums(const GrayView& image)
    : width_(std::max(0, image.width - kTemplateSize + 1)),
      height_(std::max(0, image.height - kTemplateSize + 1)) {
  const auto count = static_cast<size_t>(width_);
  sums_.resize(count * static_cast<size_t>(height_));
  squares_.resize(sums_.size());
  if (sums_.empty()) return;
  // Down each column, over as many rows as a window has.
  std::vector<uint16_t> column_sums(static_cast<size_t>(image.width));
  std::vector<int32_t> column_squares(column_sums.size());
  const auto add = [&](const uint8_t* row, int sign) {
    for (size_t x = 0; x < column_sums.size(); ++x) {
      column_sums[x] = static_cast<uint16_t>(column_sums[x] + sign * row[x]);
      column_squares[x] += sign * row[x] * row[x];
    }
  };
  for (int y = 0; y < kTemplateSize - 1; ++y) add(image.row(y), 1);
  for (int y = 0; y < height_; ++y) {
    add(image.row(y + kTemplateSize - 1), 1);
    sum_eight(column_sums, count, &sums_[index(0, y)]);
    sum_eight(column_squares, count, &squares_[index(0, y)]);
    add(image.row(y), -1);
  }
}

void kernels::search_zmssd(const PatchTemplate& patch, const GrayView& level_image, const BoxSums& sums,
                           std::span<const PixelRun> runs, float ratio, int* limit,
                           std::vector<PatchMatch>* out, Simd simd) {
  ZmssdMatches matches{ratio, *limit, out};
  if (simd == Simd::kWide && level_image.width >= kBytesLoaded) {
    find_wide(patch, level_image, sums, runs, &matches);
  } else {
    find_one_by_one(patch, level_image, runs, simd, &matches);
  }
  *limit = matches.limit;
}

void search_zmssd(const PatchTemplate& patch, const GrayView& level_image, const BoxSums& sums,
                  std::span<const PixelRun> runs, float ratio, int* limit, std::vector<PatchMatch>* out) {
  kernels::search_zmssd(patch, level_image, sums, runs, ratio, limit, out, best_simd());
}

void search_zmssd(const PatchTemplate& patch, const GrayView& level_image, std::span<const PixelRun> runs,
                  float ratio, int* limit, std::vector<PatchMatch>* out) {
  ZmssdMatches matches{ratio, *limit, out};
  find_one_by_one(patch, level_image, runs, best_simd(), &matches);
  *limit = matches.limit;
}

}  // namespace cairn
