// SPDX-License-Identifier: Apache-2.0
#include "common/image/box_sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "common/image/kernels.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;

PatchTemplate noise_template(std::mt19937* rng) {
  const TightImage image = TightImage::noise(24, 24, 255, rng);
  SourcePatch source{};
  PatchTemplate patch;
  EXPECT_TRUE(cut_source_patch(image.view(), {12, 12}, &source));
  EXPECT_TRUE(make_template(source, Warp::Identity(), 0, &patch));
  return patch;
}

TEST(BoxSumsTest, AreThoseOfEachWindow) {
  std::mt19937 rng(11);
  const TightImage image = TightImage::noise(37, 21, 255, &rng);
  const BoxSums sums(image.view());
  ASSERT_EQ(sums.width(), 30);
  ASSERT_EQ(sums.height(), 14);
  for (int top = 0; top < sums.height(); ++top) {
    for (int left = 0; left < sums.width(); ++left) {
      int sum = 0;
      int squares = 0;
      for (int j = 0; j < 8; ++j) {
        for (int i = 0; i < 8; ++i) {
          const int pixel = image.view().at(left + i, top + j);
          sum += pixel;
          squares += pixel * pixel;
        }
      }
      ASSERT_EQ(*sums.sums(left, top), sum) << left << ' ' << top;
      ASSERT_EQ(*sums.squares(left, top), squares) << left << ' ' << top;
    }
  }
}

TEST(BoxSumsTest, NoneWhereTheImageIsSmallerThanAWindow) {
  const GrayImage image = test::render(7, 30, [](int, int) { return 9; });
  EXPECT_EQ(BoxSums(image).width(), 0);
}

/// Whatever is below the limit, which what is found lowers.
std::vector<PatchMatch> find_plainly(const PatchTemplate& patch, const GrayView& image,
                                     const std::vector<PixelRun>& runs, float ratio, int limit) {
  std::vector<PatchMatch> found;
  for (const PixelRun& run : runs) {
    for (int x = run.first; x <= run.last; ++x) {
      const int score = kernels::zmssd_at(patch, image, x, run.row, Simd::kScalar);
      if (score >= limit) continue;
      found.push_back({{static_cast<int16_t>(x), static_cast<int16_t>(run.row)}, score});
      limit = static_cast<int>(std::min<double>(limit, std::ceil(score / static_cast<double>(ratio))));
    }
  }
  return found;
}

void expect_equal(const std::vector<PatchMatch>& found, const std::vector<PatchMatch>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].corner, expected[i].corner);
    ASSERT_EQ(found[i].zmssd, expected[i].zmssd);
  }
}

/// Images down to the narrowest, every row of windows, from every column to every other, and to none.
TEST(ZmssdSearchTest, EveryVariantComparesEveryPositionOfARun) {
  constexpr int kAll = std::numeric_limits<int>::max();
  constexpr float kKeepsAll = 1e-9F;
  std::mt19937 rng(12);
  for (const int width : {8, 15, 16, 17, 23, 24, 40}) {
    const TightImage image = TightImage::noise(width, 12, 255, &rng);
    const BoxSums sums(image.view());
    const PatchTemplate patch = noise_template(&rng);
    for (int y = 4; y <= 8; ++y) {
      for (int from = 4; from <= width - 4; ++from) {
        for (int to = from - 1; to <= width - 4; ++to) {
          const std::vector<PixelRun> runs = {{y, from, to}};
          const auto expected = find_plainly(patch, image.view(), runs, kKeepsAll, kAll);
          ASSERT_EQ(expected.size(), static_cast<size_t>(to - from + 1));
          for (const Simd simd : test::simd_variants()) {
            SCOPED_TRACE(::testing::Message()
                         << "width " << width << ", row " << y << ", " << from << " to " << to);
            std::vector<PatchMatch> found;
            int limit = kAll;
            kernels::search_zmssd(patch, image.view(), sums, runs, kKeepsAll, &limit, &found, simd);
            ASSERT_NO_FATAL_FAILURE(expect_equal(found, expected));
          }
        }
      }
    }
  }
}

TEST(ZmssdSearchTest, WhatIsFoundLowersTheLimitToAShareOfIt) {
  constexpr double kRatio = 0.75;  // without rounding, as a float too
  std::mt19937 rng(13);
  const TightImage image = TightImage::noise(60, 40, 60, &rng);
  const BoxSums sums(image.view());
  const std::vector<PixelRun> runs = {{20, 10, 50}, {21, 4, 56}, {12, 30, 29}, {30, 7, 9}};
  size_t kept = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const PatchTemplate patch = noise_template(&rng);
    const int first_limit = trial % 2 == 0 ? 64 * 10000 : std::numeric_limits<int>::max();
    const auto expected = find_plainly(patch, image.view(), runs, kRatio, first_limit);
    kept += expected.size();
    for (const Simd simd : test::simd_variants()) {
      std::vector<PatchMatch> found;
      int limit = first_limit;
      kernels::search_zmssd(patch, image.view(), sums, runs, kRatio, &limit, &found, simd);
      ASSERT_NO_FATAL_FAILURE(expect_equal(found, expected));
      for (const PatchMatch& m : found) ASSERT_LE(limit, std::ceil(m.zmssd / kRatio));
    }
    std::vector<PatchMatch> without_sums;
    int limit = first_limit;
    search_zmssd(patch, image.view(), runs, kRatio, &limit, &without_sums);
    ASSERT_NO_FATAL_FAILURE(expect_equal(without_sums, expected));
    for (const PatchMatch& m : without_sums) ASSERT_LE(limit, std::ceil(m.zmssd / kRatio));
  }
  EXPECT_GT(kept, 100U);
  EXPECT_LT(kept, 50U * 90);
}

TEST(ZmssdSearchTest, ExtremesDoNotOverflow) {
  const GrayImage halves = test::render(40, 24, [](int, int y) { return y < 12 ? 0 : 255; });
  const GrayImage flipped = test::render(40, 24, [](int, int y) { return y < 12 ? 255 : 0; });
  SourcePatch source{};
  PatchTemplate patch;
  ASSERT_TRUE(cut_source_patch(halves.view(), {12, 12}, &source));
  ASSERT_TRUE(make_template(source, Warp::Identity(), 0, &patch));
  const BoxSums sums(flipped.view());
  const std::vector<PixelRun> runs = {{12, 12, 20}};
  for (const Simd simd : test::simd_variants()) {
    std::vector<PatchMatch> found;
    int limit = std::numeric_limits<int>::max();
    kernels::search_zmssd(patch, flipped.view(), sums, runs, 1.0F, &limit, &found, simd);
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found.front().zmssd, 64 * 255 * 255);
  }
}

/// The largest sums there are, on either side: an image all white differs from one all black by its mean
/// only.
TEST(ZmssdSearchTest, WhiteIsBlackLessItsMean) {
  const GrayImage black = test::render(40, 24, [](int, int) { return 0; });
  const GrayImage white = test::render(40, 24, [](int, int) { return 255; });
  const std::vector<PixelRun> runs = {{12, 12, 20}};
  for (const auto& [of, in] : {std::pair(&black, &white), std::pair(&white, &black)}) {
    SourcePatch source{};
    PatchTemplate patch;
    ASSERT_TRUE(cut_source_patch(of->view(), {12, 12}, &source));
    ASSERT_TRUE(make_template(source, Warp::Identity(), 0, &patch));
    const BoxSums sums(in->view());
    for (const Simd simd : test::simd_variants()) {
      std::vector<PatchMatch> found;
      int limit = 1;
      kernels::search_zmssd(patch, in->view(), sums, runs, 1.0F, &limit, &found, simd);
      ASSERT_EQ(found.size(), 1U) << "the first leaves nothing that could be better";
      EXPECT_EQ(found.front().zmssd, 0);
      EXPECT_EQ(limit, 0);
    }
  }
}

}  // namespace
}  // namespace cairn
