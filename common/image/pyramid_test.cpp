// SPDX-License-Identifier: Apache-2.0
#include "common/image/pyramid.h"

#include <gtest/gtest.h>

#include "common/image/kernels.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;

TEST(HalveTest, EveryVariantGivesTheRoundedMeanOfFour) {
  std::mt19937 rng(1);
  for (int width = 0; width <= 140; ++width) {
    const TightImage image = TightImage::noise(width, 5, 200, &rng);
    for (const Simd simd : test::simd_variants()) {
      GrayImage half;
      kernels::halve(image.view(), &half, simd);
      ASSERT_EQ(half.width(), width / 2);
      ASSERT_EQ(half.height(), 2);
      for (int y = 0; y < half.height(); ++y) {
        for (int x = 0; x < half.width(); ++x) {
          const GrayView v = image.view();
          const int sum = v.at(2 * x, 2 * y) + v.at(2 * x + 1, 2 * y) + v.at(2 * x, 2 * y + 1) +
                          v.at(2 * x + 1, 2 * y + 1);
          ASSERT_EQ(half.view().at(x, y), (sum + 2) / 4)
              << "width " << width << ", variant " << static_cast<int>(simd) << ", pixel " << x << ' ' << y;
        }
      }
    }
  }
}

TEST(PyramidTest, EachLevelIsTheHalvedOneBelow) {
  std::mt19937 rng(2);
  for (const auto& [width, height] : {std::pair{640, 480}, {641, 479}, {333, 77}, {15, 9}, {1, 1}}) {
    const TightImage image = TightImage::noise(width, height, 60, &rng);
    Pyramid pyramid;
    pyramid.build(image.view());
    GrayImage expected(image.view());
    for (int l = 0; l < kPyramidLevels; ++l) {
      const GrayImage& level = pyramid.level(l);
      ASSERT_EQ(level.width(), width >> l);
      ASSERT_EQ(level.height(), height >> l);
      for (int y = 0; y < level.height(); ++y) {
        ASSERT_EQ(std::memcmp(level.row(y), expected.row(y), static_cast<size_t>(level.width())), 0)
            << width << 'x' << height << " level " << l << " row " << y;
      }
      GrayImage next;
      kernels::halve(expected, &next, Simd::kScalar);
      expected = std::move(next);
    }
  }
}

TEST(PyramidTest, KeepsItsMemoryForFramesOfOneSize) {
  std::mt19937 rng(3);
  const TightImage first = TightImage::noise(320, 240, 30, &rng);
  const TightImage second = TightImage::noise(320, 240, 30, &rng);
  Pyramid pyramid;
  pyramid.build(first.view());
  std::array<const uint8_t*, kPyramidLevels> memory{};
  for (int l = 0; l < kPyramidLevels; ++l) memory[static_cast<size_t>(l)] = pyramid.level(l).row(0);
  pyramid.build(second.view());
  for (int l = 0; l < kPyramidLevels; ++l) EXPECT_EQ(pyramid.level(l).row(0), memory[static_cast<size_t>(l)]);
  EXPECT_EQ(pyramid.level(0).view().at(17, 100), second.view().at(17, 100));
}

TEST(PyramidTest, LevelCoordinatesPointAtTheSameScene) {
  // On a ramp the value of a pixel says where on level 0 its centre lies.
  const GrayImage ramp = test::render(256, 16, [](int x, int) { return x; });
  Pyramid pyramid;
  pyramid.build(ramp);
  for (int l = 0; l < kPyramidLevels; ++l) {
    for (int x = 0; x < pyramid.level(l).width(); ++x) {
      const float level0 = from_level(static_cast<float>(x), l);
      EXPECT_NEAR(pyramid.level(l).view().at(x, 0), level0, l == 0 ? 0 : 1.01) << "level " << l;
      EXPECT_FLOAT_EQ(to_level(level0, l), static_cast<float>(x));
    }
  }
}

}  // namespace
}  // namespace cairn
