// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/described_scale.h"

#include <gtest/gtest.h>

#include <random>

#include "common/image/test_textures.h"

namespace cairn {
namespace {

/// All over the picture, and beyond its borders.
TEST(DescribedScale, AFewAreDescribedAsManyAre) {
  constexpr uint64_t kSeed = 20261124;
  constexpr int kWidth = 161;
  constexpr int kHeight = 118;
  std::mt19937_64 random(kSeed);
  std::uniform_int_distribution<int> grey(0, 255);
  const GrayImage image =
      test::render(kWidth, kHeight, [&](int, int) { return static_cast<double>(grey(random)); });
  std::uniform_real_distribution<float> x(-20, kWidth + 20);
  std::uniform_real_distribution<float> y(-20, kHeight + 20);
  for (const bool is_half : {false, true}) {
    DescribedScale few(image, is_half, 1);
    DescribedScale many(image, is_half, 1000);
    int described = 0;
    constexpr int kCorners = 1000;
    for (int i = 0; i < kCorners; ++i) {
      const Eigen::Vector2f pixel(x(random), y(random));
      Descriptor one{};
      Descriptor other{};
      const bool is_inside = few.describe(pixel, &one);
      ASSERT_EQ(is_inside, many.describe(pixel, &other)) << pixel.transpose();
      EXPECT_EQ(one, other) << pixel.transpose();
      described += is_inside ? 1 : 0;
    }
    EXPECT_GT(described, kCorners / 5);
    EXPECT_LT(described, kCorners * 4 / 5);
  }
}

}  // namespace
}  // namespace cairn
