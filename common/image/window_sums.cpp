// SPDX-License-Identifier: Apache-2.0
#include "common/image/window_sums.h"

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

/// What is found, and what it must still be below.
struct Alike {
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
                     Simd simd, Alike* alike) {
  for (const PixelRun& run : runs) {
    for (int x = run.first; x <= run.last; ++x) {
      const int score = kernels::zmssd_at(patch, image, x, run.row, simd);
      if (score < alike->limit) alike->add(x, run.row, score);
    }
  }
}

/// Two pixels of a template as a factor for _mm256_madd_epi16.
using Pairs = std::array<int32_t, kPixels / 2>;

CAIRN_AVX2 CAIRN_INLINE void widen(const PatchTemplate& patch, Pairs* out) {
  for (size_t i = 0; i < kTemplatePixels; i += kBytesLoaded) {
    const __m256i wide = _mm256_cvtepu8_epi16(_mm_load_si128(vector_at(&patch.pixels[i])));
    _mm256_store_si256(reinterpret_cast<__m256i*>(&(*out)[i / 2]), wide);
  }
}

/// Lane i: the sum of the products of the template with the window whose upper left pixel is `window` + i.
CAIRN_AVX2 CAIRN_INLINE __m256i products(const Pairs& pairs, const uint8_t* window, ptrdiff_t stride) {
  // Bytes (i, i + 1) of a row as 16 bits each, for lane i.
  const __m256i first = _mm256_setr_epi8(0, -1, 1, -1, 1, -1, 2, -1, 2, -1, 3, -1, 3, -1, 4, -1,  //
                                         4, -1, 5, -1, 5, -1, 6, -1, 6, -1, 7, -1, 7, -1, 8, -1);
  const __m256i two = _mm256_setr_epi8(2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0,  //
                                       2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0);
  const __m256i second = _mm256_add_epi8(first, two);
  const __m256i third = _mm256_add_epi8(second, two);
  const __m256i fourth = _mm256_add_epi8(third, two);
  __m256i even = _mm256_setzero_si256();
  __m256i odd = even;
#pragma GCC unroll 8
  for (size_t j = 0; j < kTemplateSize; ++j) {
    const __m256i row =
        _mm256_broadcastsi128_si256(_mm_loadu_si128(vector_at(window + static_cast<ptrdiff_t>(j) * stride)));
    const int32_t* pair = &pairs[j * kTemplateSize / 2];
    const auto times = [&](const __m256i& bytes, int32_t by) CAIRN_AVX2 {
      return _mm256_madd_epi16(_mm256_shuffle_epi8(row, bytes), _mm256_set1_epi32(by));
    };
    even = _mm256_add_epi32(even, times(first, pair[0]));
    odd = _mm256_add_epi32(odd, times(second, pair[1]));
    even = _mm256_add_epi32(even, times(third, pair[2]));
    odd = _mm256_add_epi32(odd, times(fourth, pair[3]));
  }
  return _mm256_add_epi32(even, odd);
}

/// The exact value rounded down, as zmssd_at() has it.
CAIRN_AVX2 CAIRN_INLINE __m256i scores(const PatchTemplate& patch, const Pairs& pairs, const GrayView& image,
                                       const WindowSums& sums, int left, int top) {
  const __m256i p = products(pairs, image.row(top) + left, image.stride);
  const __m256i window_sums =
      _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(sums.sums(left, top))));
  const __m256i window_squares =
      _mm256_loadu_si256(reinterpret_cast<const __m256i*>(sums.squares(left, top)));
  const __m256i d = _mm256_sub_epi32(_mm256_set1_epi32(patch.sum), window_sums);
  const __m256i squares = _mm256_sub_epi32(
      _mm256_add_epi32(_mm256_set1_epi32(patch.sum_squares), window_squares), _mm256_slli_epi32(p, 1));
  return _mm256_srai_epi32(_mm256_sub_epi32(_mm256_slli_epi32(squares, 6), _mm256_mullo_epi32(d, d)), 6);
}

CAIRN_AVX2 void find_avx2(const PatchTemplate& patch, const GrayView& image, const WindowSums& sums,
                          std::span<const PixelRun> runs, Alike* alike) {
  alignas(32) Pairs pairs;
  widen(patch, &pairs);
  alignas(32) std::array<int, kLanes> eight;
  for (const PixelRun& run : runs) {
    for (int x = run.first; x <= run.last;) {
      // Near the image's right end the first lanes are of windows that are not asked for.
      const int left = std::min(x - kHalf, image.width - kBytesLoaded);
      const int skipped = x - kHalf - left;
      if (skipped == kLanes) {  // the last window of the row
        find_one_by_one(patch, image, {{{run.row, x, x}}}, Simd::kAvx2, alike);
        break;
      }
      const int wanted = std::min(run.last - x + 1, kLanes - skipped);
      const __m256i all = scores(patch, pairs, image, sums, left, run.row - kHalf);
      const __m256i below = _mm256_cmpgt_epi32(_mm256_set1_epi32(alike->limit), all);
      auto bits = static_cast<uint32_t>(_mm256_movemask_ps(_mm256_castsi256_ps(below))) >> skipped;
      bits &= (1U << wanted) - 1;
      if (bits != 0) _mm256_store_si256(reinterpret_cast<__m256i*>(eight.data()), all);
      for (; bits != 0; bits &= bits - 1) {
        const int lane = std::countr_zero(bits);
        const int score = eight[static_cast<size_t>(skipped + lane)];
        if (score < alike->limit) alike->add(x + lane, run.row, score);
      }
      x += wanted;
    }
  }
}

}  // namespace

WindowSums::WindowSums(const GrayView& image)
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

void kernels::find_alike(const PatchTemplate& patch, const GrayView& level_image, const WindowSums& sums,
                         std::span<const PixelRun> runs, float ratio, int* limit,
                         std::vector<PatchMatch>* out, Simd simd) {
  Alike alike{ratio, *limit, out};
  if (simd == Simd::kAvx2 && level_image.width >= kBytesLoaded) {
    find_avx2(patch, level_image, sums, runs, &alike);
  } else {
    find_one_by_one(patch, level_image, runs, simd, &alike);
  }
  *limit = alike.limit;
}

void find_alike(const PatchTemplate& patch, const GrayView& level_image, const WindowSums& sums,
                std::span<const PixelRun> runs, float ratio, int* limit, std::vector<PatchMatch>* out) {
  kernels::find_alike(patch, level_image, sums, runs, ratio, limit, out, best_simd());
}

void find_alike(const PatchTemplate& patch, const GrayView& level_image, std::span<const PixelRun> runs,
                float ratio, int* limit, std::vector<PatchMatch>* out) {
  Alike alike{ratio, *limit, out};
  find_one_by_one(patch, level_image, runs, best_simd(), &alike);
  *limit = alike.limit;
}

}  // namespace cairn
