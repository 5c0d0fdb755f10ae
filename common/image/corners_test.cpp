// SPDX-License-Identifier: Apache-2.0
#include "common/image/corners.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <array>

#include "common/image/kernels.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;

constexpr std::array<std::array<int, 2>, 16> kCircle = {{{0, -3},
                                                         {1, -3},
                                                         {2, -2},
                                                         {3, -1},
                                                         {3, 0},
                                                         {3, 1},
                                                         {2, 2},
                                                         {1, 3},
                                                         {0, 3},
                                                         {-1, 3},
                                                         {-2, 2},
                                                         {-3, 1},
                                                         {-3, 0},
                                                         {-3, -1},
                                                         {-2, -2},
                                                         {-1, -3}}};

/// The definition, arc by arc.
bool is_corner(const GrayView& image, int x, int y, int threshold) {
  const int center = image.at(x, y);
  for (size_t first = 0; first < 16; ++first) {
    bool bright = true;
    bool dark = true;
    for (size_t k = 0; k < 10; ++k) {
      const auto [dx, dy] = kCircle[(first + k) % 16];
      const int value = image.at(x + dx, y + dy);
      bright = bright && value > center + threshold;
      dark = dark && value < center - threshold;
    }
    if (bright || dark) return true;
  }
  return false;
}

std::vector<Corner> corners_by_definition(const GrayView& image, int threshold) {
  std::vector<Corner> corners;
  for (int y = 3; y < image.height - 3; ++y) {
    for (int x = 3; x < image.width - 3; ++x) {
      if (is_corner(image, x, y, threshold))
        corners.push_back({static_cast<int16_t>(x), static_cast<int16_t>(y)});
    }
  }
  return corners;
}

TEST(Fast10Test, EveryVariantFollowsTheDefinition) {
  std::mt19937 rng(1);
  size_t total = 0;
  for (int width = 0; width <= 110; ++width) {
    const int step = std::array{15, 40, 120}[static_cast<size_t>(width % 3)];
    const TightImage image = TightImage::noise(width, 6 + width % 9, step, &rng);
    for (const int threshold : {0, 1, 10, 15, 40, 128, 254, 255}) {
      const std::vector<Corner> expected = corners_by_definition(image.view(), threshold);
      total += expected.size();
      for (const Simd simd : test::simd_variants()) {
        CornerList list;
        kernels::detect_fast10(image.view(), threshold, &list, simd);
        ASSERT_EQ(list.corners, expected)
            << "width " << width << ", threshold " << threshold << ", variant " << static_cast<int>(simd);
      }
    }
  }
  EXPECT_GT(total, 1000U);
}

TEST(Fast10Test, TenInARowAreACornerAndNineAreNot) {
  constexpr int kThreshold = 20;
  for (const bool bright : {true, false}) {
    for (size_t first = 0; first < 16; ++first) {
      for (const size_t length : {size_t{9}, size_t{10}}) {
        for (const int margin : {0, 1}) {  // a difference of exactly the threshold does not count
          TightImage image(45, 7);
          std::fill(image.pixels().begin(), image.pixels().end(), uint8_t{100});
          const int x = 3 + static_cast<int>(first * 2);
          const int difference = (kThreshold + margin) * (bright ? 1 : -1);
          for (size_t k = 0; k < length; ++k) {
            const auto [dx, dy] = kCircle[(first + k) % 16];
            image.pixels()[static_cast<size_t>((3 + dy) * 45 + x + dx)] =
                static_cast<uint8_t>(100 + difference);
          }
          CornerList list;
          detect_fast10(image.view(), kThreshold, &list);
          const bool found = std::find(list.corners.begin(), list.corners.end(),
                                       Corner{static_cast<int16_t>(x), 3}) != list.corners.end();
          EXPECT_EQ(found, length == 10 && margin == 1)
              << "arc " << first << '+' << length << " bright " << bright;
        }
      }
    }
  }
}

TEST(Fast10Test, RowTableCoversTheListInOrder) {
  std::mt19937 rng(2);
  const TightImage image = TightImage::noise(200, 60, 40, &rng);
  CornerList list;
  detect_fast10(image.view(), 15, &list);
  ASSERT_FALSE(list.corners.empty());
  ASSERT_EQ(list.row_begin.size(), 61U);
  EXPECT_EQ(list.row_begin.front(), 0U);
  EXPECT_EQ(list.row_begin.back(), list.corners.size());
  for (size_t y = 0; y < 60; ++y) {
    for (size_t i = list.row_begin[y]; i < list.row_begin[y + 1]; ++i) {
      EXPECT_EQ(list.corners[i].y, static_cast<int>(y));
      if (i > list.row_begin[y]) {
        EXPECT_LT(list.corners[i - 1].x, list.corners[i].x);
      }
    }
  }
}

TEST(Fast10Test, ReusesMemory) {
  std::mt19937 rng(3);
  const TightImage image = TightImage::noise(200, 60, 40, &rng);
  CornerList list;
  detect_fast10(image.view(), 15, &list);
  const Corner* memory = list.corners.data();
  const uint32_t* rows = list.row_begin.data();
  detect_fast10(image.view(), 15, &list);
  EXPECT_EQ(list.corners.data(), memory);
  EXPECT_EQ(list.row_begin.data(), rows);
}

TEST(Fast10Test, NegativeHasTheSameCorners) {
  std::mt19937 rng(4);
  TightImage image = TightImage::noise(150, 40, 50, &rng);
  CornerList positive;
  detect_fast10(image.view(), 12, &positive);
  for (uint8_t& p : image.pixels()) p = static_cast<uint8_t>(255 - p);
  CornerList negative;
  detect_fast10(image.view(), 12, &negative);
  ASSERT_FALSE(positive.corners.empty());
  EXPECT_EQ(positive.corners, negative.corners);
}

TEST(Fast10ScoreTest, IsTheLargestThresholdThatPasses) {
  std::mt19937 rng(5);
  const TightImage image = TightImage::noise(120, 40, 60, &rng);
  for (int y = 3; y < 37; ++y) {
    for (int x = 3; x < 117; ++x) {
      const int score = fast10_score(image.view(), x, y);
      EXPECT_FALSE(is_corner(image.view(), x, y, score + 1)) << x << ' ' << y;
      if (score > 0) {
        EXPECT_TRUE(is_corner(image.view(), x, y, score)) << x << ' ' << y;
      }
    }
  }
}

TEST(ShiTomasiTest, IsTheSmallerEigenvalueOfTheGradientMatrix) {
  std::mt19937 rng(6);
  const TightImage image = TightImage::noise(40, 40, 60, &rng);
  const GrayView v = image.view();
  for (const int half : {1, 3, 5}) {
    for (int x = half + 1; x < 39 - half; x += 3) {
      Eigen::Matrix2d m = Eigen::Matrix2d::Zero();
      for (int j = 20 - half; j <= 20 + half; ++j) {
        for (int i = x - half; i <= x + half; ++i) {
          const Eigen::Vector2d g(v.at(i + 1, j) - v.at(i - 1, j), v.at(i, j + 1) - v.at(i, j - 1));
          m += g * g.transpose();
        }
      }
      m /= 2.0 * (2 * half + 1) * (2 * half + 1);
      const double expected =
          Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>().computeDirect(m).eigenvalues()(0);
      EXPECT_NEAR(shi_tomasi(v, x, 20, half), expected, 1e-4 * m.trace()) << half << ' ' << x;
    }
  }
}

TEST(ShiTomasiTest, StraightEdgeHasNone) {
  const GrayImage edge = test::render(30, 30, [](int x, int) { return x < 15 ? 20 : 220; });
  EXPECT_EQ(shi_tomasi(edge, 15, 15), 0);
}

TEST(CandidatesTest, AreTheMaximaThatPassEveryLimit) {
  const test::Waves<2> texture(7, 1.2);
  const GrayImage image = test::render(160, 120, [&](int x, int y) { return texture({x, y}); });
  CornerList corners;
  detect_fast10(image, 8, &corners);
  constexpr int kBarrier = 20;
  constexpr int kBorder = 14;
  constexpr float kMinShiTomasi = 200;
  const std::vector<Candidate> candidates = find_candidates(image, corners, kBarrier, kBorder, kMinShiTomasi);
  const auto is_kept = [&](Corner c) {
    return std::any_of(candidates.begin(), candidates.end(),
                       [&](const Candidate& k) { return k.corner == c; });
  };
  ASSERT_GT(candidates.size(), 10U);
  size_t kept = 0;
  for (const Corner c : corners.corners) {
    const int score = fast10_score(image, c.x, c.y);
    bool expected =
        score >= kBarrier && c.x >= kBorder && c.y >= kBorder && c.x < 160 - kBorder && c.y < 120 - kBorder;
    for (const Corner n : corners.corners) {
      if (n == c || std::abs(n.x - c.x) > 1 || std::abs(n.y - c.y) > 1) continue;
      const int other = fast10_score(image, n.x, n.y);
      const bool earlier = n.y < c.y || (n.y == c.y && n.x < c.x);
      expected = expected && (earlier ? other < score : other <= score);
    }
    expected = expected && shi_tomasi(image, c.x, c.y) > kMinShiTomasi;
    EXPECT_EQ(is_kept(c), expected) << c.x << ' ' << c.y;
    kept += expected ? 1 : 0;
  }
  EXPECT_EQ(kept, candidates.size());
  for (const Candidate& c : candidates) EXPECT_EQ(c.score, shi_tomasi(image, c.corner.x, c.corner.y));
}

}  // namespace
}  // namespace cairn
