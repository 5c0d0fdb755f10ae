// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/reachable.h"

#include <gtest/gtest.h>

#include <cmath>

namespace cairn {
namespace {

/// A walk along x at 0.7 depths a second, looking ahead; the depth is 2.
ProvenMotion walk() {
  ProvenMotion motion;
  motion.depth = 2;
  motion.velocity = {1.4, 0, 0};
  return motion;
}

SuggestedPose at(double seconds, const Eigen::Vector3d& centre, double turned = 0) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(turned, Eigen::Vector3d::UnitY()));
  return {Timestamp::from_seconds(seconds), SE3(turn, -(turn * centre)), Eigen::Matrix3d::Zero()};
}

TEST(Reachable, WhoWalksGoesOnOrStopsAndIsNotABayOff) {
  for (const double seconds : {0.1, 0.3, 0.6}) {
    EXPECT_TRUE(reach(walk(), at(seconds, {1.4 * seconds, 0, 0})).is_reachable) << "walks on";
    EXPECT_TRUE(reach(walk(), at(seconds, {0, 0, 0})).is_reachable) << "stands";
    EXPECT_FALSE(reach(walk(), at(seconds, {-1.5, 0, 0})).is_reachable) << "a bay back";
    EXPECT_FALSE(reach(walk(), at(seconds, {1.4 * seconds + 1.5, 0, 0})).is_reachable) << "a bay ahead";
  }
}

TEST(Reachable, TheLongerItWasHiddenTheFartherItMayBe) {
  double last = INFINITY;
  for (const double seconds : {0.0, 0.2, 0.5, 1.0, 1.4, 3.0}) {
    const Reach back = reach(walk(), at(seconds, {-3, 0, 0}));
    EXPECT_LE(back.beyond, last) << seconds;
    EXPECT_EQ(back.is_reachable, back.beyond == 0);
    last = back.beyond;
  }
  EXPECT_EQ(last, 0);
}

TEST(Reachable, OfABeyondPoseMoreIsAskedThanOfTheOthers) {
  EXPECT_EQ(reach(walk(), at(0.3, {0.4, 0, 0})).needed_margin, 1);
  EXPECT_GT(reach(walk(), at(0.3, {-2, 0, 0})).needed_margin, 1);
}

TEST(Reachable, TheUnitOfTheMapDoesNotMatter) {
  for (const double unit : {0.01, 1.0, 100.0}) {
    ProvenMotion motion = walk();
    motion.depth *= unit;
    motion.velocity *= unit;
    EXPECT_TRUE(reach(motion, at(0.5, {0.5 * unit, 0.2 * unit, 0})).is_reachable);
    EXPECT_NEAR(reach(motion, at(0.5, {0, 3 * unit, 0})).beyond, reach(walk(), at(0.5, {0, 3, 0})).beyond,
                1e-9);
  }
}

TEST(Reachable, WhatIsUncertainMayBeNearer) {
  SuggestedPose pose = at(0.2, {0, 0.3, 0});
  EXPECT_FALSE(reach(walk(), pose).is_reachable);
  pose.covariance(0, 0) = 0.01;  // along the way, which says nothing of aside
  EXPECT_FALSE(reach(walk(), pose).is_reachable);
  pose.covariance(1, 1) = 0.01;
  EXPECT_TRUE(reach(walk(), pose).is_reachable);
}

TEST(Reachable, ATurnTakesTime) {
  EXPECT_FALSE(reach(walk(), at(0.1, {0.14, 0, 0}, M_PI)).is_reachable) << "it looks back";
  EXPECT_TRUE(reach(walk(), at(0.8, {0.14, 0, 0}, M_PI)).is_reachable);
  ProvenMotion turning = walk();
  EXPECT_FALSE(reach(turning, at(0.1, {0.14, 0, 0}, 0.3)).is_reachable);
  turning.turn_rate = 2.6;  // 150 degrees a second
  EXPECT_TRUE(reach(turning, at(0.1, {0.14, 0, 0}, 0.3)).is_reachable);
}

TEST(Reachable, TimeThatRunsBackSaysNothing) {
  EXPECT_TRUE(reach(walk(), at(-1, {-50, 0, 0}, M_PI)).is_reachable);
}

}  // namespace
}  // namespace cairn
