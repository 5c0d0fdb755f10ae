// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/depth_order.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;
constexpr float kBehind = 1.4F;

/// A screen at 0.5 m in the middle of the image, a wall at 1 m around it.
DepthOrder screen_before_wall() {
  DepthOrder order(kWidth, kHeight);
  for (float y = 8; y < kHeight; y += 16) {
    for (float x = 8; x < kWidth; x += 16) {
      const bool on_screen = x > 200 && x < 440 && y > 150 && y < 330;
      order.add({x, y}, on_screen ? 0.5F : 1.0F);
    }
  }
  return order;
}

TEST(DepthOrder, WhatStandsBehindNearerPointsIsHidden) {
  const DepthOrder order = screen_before_wall();
  EXPECT_TRUE(order.is_hidden({320, 240}, 1, kBehind));
  EXPECT_FALSE(order.is_hidden({320, 240}, 0.5F, kBehind)) << "the screen itself";
  EXPECT_FALSE(order.is_hidden({320, 240}, 0.2F, kBehind)) << "before it";
  EXPECT_FALSE(order.is_hidden({100, 100}, 1, kBehind)) << "the wall beside it";
}

TEST(DepthOrder, OnePointAloneHidesNothing) {
  DepthOrder order(kWidth, kHeight);
  order.add({300, 200}, 0.2F);
  EXPECT_FALSE(order.is_hidden({305, 205}, 1, kBehind));
  order.add({310, 200}, 0.2F);
  EXPECT_TRUE(order.is_hidden({305, 205}, 1, kBehind));
  order.clear();
  EXPECT_FALSE(order.is_hidden({305, 205}, 1, kBehind)) << "forgotten";
}

TEST(DepthOrder, ASlantedPlaneHidesNoneOfItsOwnPoints) {
  const auto depth_at = [](float y) { return 1 / (1 + (y - 240) / 525 * 1.19F); };  // turned by 50 degrees
  DepthOrder order(kWidth, kHeight);
  for (float y = 4; y < kHeight; y += 8) {
    for (float x = 4; x < kWidth; x += 16) order.add({x, y}, depth_at(y));
  }
  for (float y = 4; y < kHeight; y += 8) {
    for (float x = 12; x < kWidth; x += 16)
      EXPECT_FALSE(order.is_hidden({x, y}, depth_at(y), kBehind)) << x << " " << y;
  }
}

TEST(DepthOrder, PixelsOnTheRimAndBeyondCountForTheRim) {
  DepthOrder order = screen_before_wall();
  EXPECT_TRUE(order.is_hidden({kWidth - 1, kHeight - 1}, 3, kBehind));
  EXPECT_TRUE(order.is_hidden({0, 0}, 3, kBehind));
  EXPECT_TRUE(order.is_hidden({-50, 10000}, 3, kBehind));
  order.add({-1e4F, -1e4F}, 0.1F);
  order.add({-1e4F, -1e4F}, 0.1F);
  EXPECT_TRUE(order.is_hidden({0, 0}, 1, kBehind));
}

}  // namespace
}  // namespace cairn
