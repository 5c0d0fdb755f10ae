// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/motion_profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "hw/can/test_seed.h"

namespace cairn {
namespace {

constexpr double kPeriod = 0.01;
constexpr MotionLimits kLimits{
    .low = -1, .high = 1, .margin = 0.08, .rate = 2, .acceleration = 10, .coasting = 5, .reaction = 0.05};

TEST(MotionProfile, WhateverIsDemandedStaysWithinPositionRateAndAcceleration) {
  const uint32_t seed = testing::any_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  MotionProfile profile(kLimits, kPeriod, 0.9 * unit(random));
  Demand demand;
  for (int i = 0; i < 100'000; ++i) {
    if (random() % 40 == 0) {
      demand = {std::nullopt, 5 * unit(random)};
      if (random() % 2 == 0) demand = {2 * unit(random), random() % 2 == 0 ? 0 : 3 * unit(random)};
    }
    const double before = profile.rate();
    profile.advance(demand);
    ASSERT_LE(std::abs(profile.position()), 0.92 + 1e-9);
    ASSERT_LE(std::abs(profile.rate()), kLimits.rate + 1e-9);
    ASSERT_LE(std::abs(profile.rate() - before), kLimits.acceleration * kPeriod * (1 + 1e-6));
    // Let go, it still goes on for `reaction` and then slows by friction alone.
    const double ahead = std::abs(profile.rate()) * kLimits.reaction +
                         profile.rate() * profile.rate() / (2 * kLimits.coasting);
    ASSERT_LE(std::abs(profile.position() + std::copysign(ahead, profile.rate())), 1 + 1e-9);
  }
}

TEST(MotionProfile, ArrivesAndStaysWithoutOvershoot) {
  for (const double target : {0.001, 0.01, 0.3, -0.77}) {
    MotionProfile profile(kLimits, kPeriod, 0);
    for (int i = 0; i < 200; ++i) {
      profile.advance({target, 0});
      EXPECT_LE(std::abs(profile.position()), std::abs(target) + 1e-12);
    }
    EXPECT_NEAR(profile.position(), target, 1e-12);
    EXPECT_NEAR(profile.rate(), 0, 1e-9);
  }
}

TEST(MotionProfile, FollowsATargetThatMovesOn) {
  MotionProfile profile(kLimits, kPeriod, -0.5);
  for (int i = 0; i < 200; ++i) profile.advance({-0.5 + 0.5 * i * kPeriod, 0.5});
  EXPECT_NEAR(profile.rate(), 0.5, 1e-6);
  EXPECT_NEAR(profile.position(), -0.5 + 0.5 * 200 * kPeriod, 0.02);
}

TEST(MotionProfile, FromBeyondTheSoftLimitsItGoesInwardOnly) {
  MotionProfile profile(kLimits, kPeriod, 0.97);
  profile.advance({std::nullopt, 1});
  EXPECT_EQ(profile.position(), 0.97);
  for (int i = 0; i < 300; ++i) profile.advance({0.5, 0});
  EXPECT_NEAR(profile.position(), 0.5, 1e-9);
}

}  // namespace
}  // namespace cairn
