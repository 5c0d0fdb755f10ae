// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/wearer.h"

#include <gtest/gtest.h>

#include <numbers>

namespace cairn::simulated {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;

double angle_to(const Eigen::Quaterniond& world_from_base, const Vector3d& direction) {
  const Vector3d ahead = world_from_base * Vector3d::UnitX();
  return std::atan2(ahead.cross(direction).norm(), ahead.dot(direction));
}

TEST(Wearer, StandsTwoMetresFromThePointAndFacesIt) {
  const Wearer wearer;
  for (const double t : {0.0, 5.0}) {
    EXPECT_NEAR(wearer.position(t).norm(), 2, 1e-9);
    EXPECT_NEAR(angle_to(wearer.world_from_base(t), -wearer.position(t)), 0, 1e-9);
    EXPECT_NEAR(wearer.rate(t).norm(), 0, 1e-9);
    EXPECT_NEAR(wearer.acceleration(t).z(), 9.80665, 1e-6);
  }
}

/// Whatever is asked for and when: no body jumps, and rates and accelerations are those of the motion.
TEST(Wearer, NeverJumpsAndEndsWhereItStands) {
  Wearer wearer;
  double worst_step = 0;
  double worst_turn = 0;
  double fastest = 0;
  constexpr double kStep = 1e-3;
  for (int i = 0; i < 20'000; ++i) {
    const double t = i * kStep;
    if (i == 1000) wearer.walk(1, 0.5, t);
    if (i == 1300) wearer.stand(t);  // before it is at speed
    if (i == 4000) wearer.walk(1.5, -0.3, t);
    if (i == 7000) wearer.turn(150 * kDegree, 1.5, t);
    if (i == 7700) wearer.walk(2, 0, t);  // while it walks and turns
    if (i == 12'000) wearer.turn(-150 * kDegree, 1.5, t);
    if (i == 14'000) wearer.stand(t);
    worst_step = std::max(worst_step, (wearer.position(t + kStep) - wearer.position(t)).norm());
    const double turn = wearer.world_from_base(t).angularDistance(wearer.world_from_base(t + kStep));
    worst_turn = std::max(worst_turn, turn);
    EXPECT_NEAR(turn / kStep, wearer.rate(t + kStep / 2).norm(), 0.02) << t;
    fastest = std::max(fastest, (wearer.acceleration(t) - Vector3d(0, 0, 9.81)).norm());
  }
  EXPECT_LT(worst_step / kStep, 2);              // [m/s]
  EXPECT_LT(worst_turn / kStep, 420 * kDegree);  // a turn of 190 deg/s and the sways at 2 Hz
  EXPECT_LT(fastest, 15);                        // [m/s^2]
  EXPECT_NEAR(wearer.rate(20).norm(), 0, 1e-9);
  EXPECT_NEAR(wearer.position(20).norm(), 2, 1e-9);
  EXPECT_NEAR(angle_to(wearer.world_from_base(20), -wearer.position(20)), 0, 1e-9);  // turned there and back
}

TEST(Wearer, WalksAroundThePointAndSwaysMeanwhile) {
  Wearer wearer;
  wearer.walk(1, 0.5, 0);
  double most = 0;
  for (double t = 2; t < 6; t += 0.01) {
    most = std::max(most, angle_to(wearer.world_from_base(t), -wearer.position(t)));
    EXPECT_NEAR(wearer.position(t).norm(), 2, 0.1);
  }
  EXPECT_NEAR(most, 12 * kDegree, 2 * kDegree);  // 10 upright and 7 aside, and the steps
  const Vector3d from = wearer.position(2);
  const Vector3d to = wearer.position(4);
  EXPECT_NEAR(std::atan2(from.cross(to).z(), from.dot(to)), 1, 0.05);
}

TEST(Wearer, ASecondTurnAddsToTheFirstHoweverLongAgoThatWas) {
  Wearer wearer;
  wearer.turn(1, 1, 0);
  wearer.turn(1, 1, 100);
  EXPECT_NEAR(angle_to(wearer.world_from_base(200), Vector3d(std::cos(2), std::sin(2), 0)), 0, 1e-9);
}

}  // namespace
}  // namespace cairn::simulated
