// SPDX-License-Identifier: Apache-2.0
#include "common/map/extent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace cairn {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

const double kNotANumber = std::numeric_limits<double>::quiet_NaN();

TEST(Extent, ABoxHoldsItsBorderAndNothingBeyond) {
  const Extent box = Box{{-1, 0, 2}, {1, 3, 4}};
  EXPECT_TRUE(contains(box, {-1, 0, 2}));
  EXPECT_TRUE(contains(box, {1, 3, 4}));
  EXPECT_FALSE(contains(box, {1.001, 1, 3}));
  EXPECT_FALSE(contains(box, {0, -0.001, 3}));
}

TEST(Extent, ASphereHoldsWhatIsWithinItsRadius) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Sphere sphere{{1, 2, 3}, 2};
  for (int i = 0; i < 100; ++i) {
    const Vector3d direction = Vector3d{normal(random), normal(random), normal(random)}.normalized();
    EXPECT_TRUE(contains(sphere, sphere.center + 1.999 * direction));
    EXPECT_FALSE(contains(sphere, sphere.center + 2.001 * direction));
  }
}

TEST(Extent, NothingThatIsNotFiniteIsInside) {
  EXPECT_FALSE(contains(Box{{-1, -1, -1}, {1, 1, 1}}, {0, kNotANumber, 0}));
  EXPECT_FALSE(contains(Sphere{{0, 0, 0}, 1}, {0, kNotANumber, 0}));
}

TEST(Extent, WhatNoPlaceCanBeInIsRefusedByName) {
  EXPECT_TRUE(check(Box{{0, 0, 0}, {1, 1, 1}}));
  EXPECT_TRUE(check(Sphere{{0, 0, 0}, 1}));
  EXPECT_THAT(check(Box{{0, 0, 0}, {1, -1, 1}}).error().message, HasSubstr("has no inside"));
  EXPECT_THAT(check(Box{{kNotANumber, 0, 0}, {1, 1, 1}}).error().message, HasSubstr("not finite"));
  EXPECT_THAT(check(Sphere{{0, 0, 0}, 0}).error().message, HasSubstr("not positive"));
  EXPECT_THAT(check(Sphere{{0, 0, 0}, kNotANumber}).error().message, HasSubstr("not finite"));
}

TEST(Extent, AMarginIsRoomOnEachSide) {
  EXPECT_EQ(with_margin({{0, 0, 0}, {1, 2, 3}}, 0.5), (Box{{-0.5, -0.5, -0.5}, {1.5, 2.5, 3.5}}));
}

TEST(Extent, IsDescribedForAPerson) {
  EXPECT_EQ(describe(Extent(Box{{-1, 0, -1}, {2, 1.5, 1}})), "box -1.00 0.00 -1.00 to 2.00 1.50 1.00");
  EXPECT_EQ(describe(Extent(Sphere{{0, 1, 0}, 2})), "2.00 around 0.00 1.00 0.00");
}

}  // namespace
}  // namespace cairn
