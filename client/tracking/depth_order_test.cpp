// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/depth_order.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

VisiblePoint point(float x, float y, float depth, bool found) {
  VisiblePoint p;
  p.expected = {x, y};
  p.depth = depth;
  p.searched = true;
  p.found = found;
  return p;
}

/// A screen of found points at 0.5 m in the middle of a wall at 1 m.
std::vector<VisiblePoint> screen_before_wall(bool wall_behind_is_found) {
  std::vector<VisiblePoint> points;
  for (float y = 8; y < 480; y += 16) {
    for (float x = 8; x < 640; x += 16) {
      const bool on_screen = x > 200 && x < 440 && y > 150 && y < 330;
      if (on_screen) points.push_back(point(x, y, 0.5F, true));
      points.push_back(point(x, y, 1.0F, !on_screen || wall_behind_is_found));
    }
  }
  return points;
}

TEST(DepthOrder, WhatStandsBehindFoundPointsIsHidden) {
  DepthOrder order(640, 480);
  const auto points = screen_before_wall(false);
  EXPECT_EQ(order.count_hidden(points), 14 * 12);
  EXPECT_EQ(order.count_hidden(points), 14 * 12) << "the same in the next frame";
}

TEST(DepthOrder, FoundPointsAreNotHiddenWhateverTheirDepth) {
  EXPECT_EQ(DepthOrder(640, 480).count_hidden(screen_before_wall(true)), 0);
}

TEST(DepthOrder, OneFoundPointAloneHidesNothing) {
  const std::vector<VisiblePoint> points = {point(300, 200, 0.2F, true), point(305, 205, 1.0F, false)};
  EXPECT_EQ(DepthOrder(640, 480).count_hidden(points), 0);
}

TEST(DepthOrder, ASlantedPlaneHidesNoneOfItsOwnPoints) {
  std::vector<VisiblePoint> points;
  for (float y = 4; y < 480; y += 8) {
    const float depth = 1 / (1 + (y - 240) / 525 * 1.19F);  // turned by 50 degrees
    for (float x = 4; x < 640; x += 8) points.push_back(point(x, y, depth, static_cast<int>(x / 8) % 2 == 0));
  }
  EXPECT_EQ(DepthOrder(640, 480).count_hidden(points), 0);
}

TEST(DepthOrder, PointsNotLookedForAndPixelsOnTheRimAreNoMatter) {
  auto points = screen_before_wall(false);
  for (VisiblePoint& p : points) p.searched = p.found;
  points.push_back(point(639, 479, 3, false));
  points.push_back(point(0, 0, 3, false));
  EXPECT_EQ(DepthOrder(640, 480).count_hidden(points), 2) << "those at the rim, behind the wall";
}

}  // namespace
}  // namespace cairn
