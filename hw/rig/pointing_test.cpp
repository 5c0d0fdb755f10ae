// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/pointing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "hw/rig/attitude.h"
#include "hw/rig/backlash.h"
#include "hw/rig/test_gait.h"

namespace cairn {
namespace {

using Eigen::Vector3d;
using testing::angle_between;
using testing::Gait;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kPeriod = 0.01;
const Vector3d kUp = Vector3d::UnitZ();
const Vector3d kAhead = Vector3d::UnitX();

TEST(Kinematics, TheAnglesHaveTheSignsThatTheySay) {
  const Eigen::Matrix3d ahead = base_from_camera({0, 0});
  EXPECT_TRUE(ahead.col(2).isApprox(kAhead));
  EXPECT_TRUE(ahead.col(0).isApprox(-Vector3d::UnitY()));
  EXPECT_TRUE(ahead.col(1).isApprox(-kUp));
  EXPECT_GT(optical_axis({0.1, 0}).y(), 0);  // left
  EXPECT_GT(optical_axis({0, 0.1}).z(), 0);  // up
  for (const double pan : {-2.0, 0.0, 1.0})
    EXPECT_NEAR(base_from_camera({pan, 0.3}).col(0).z(), 0, 1e-12);  // level
}

TEST(Kinematics, LookingAlongTheOpticalAxisGivesTheAnglesBack) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 1000; ++i) {
    const PanTilt angles{3.1 * unit(random), 1.5 * unit(random)};
    const PanTilt back = look_along(3 * optical_axis(angles));
    EXPECT_NEAR(back.pan, angles.pan, 1e-9);
    EXPECT_NEAR(back.tilt, angles.tilt, 1e-9);
  }
  EXPECT_EQ(look_along(kUp, 0.7).pan, 0.7);
  EXPECT_NEAR(look_along(-kUp, 0.7).tilt, -std::numbers::pi / 2, 1e-12);
}

TEST(Kinematics, TheRatesThatHoldADirectionAreTheDerivatives) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal(0, 1);
  const auto any = [&] { return Vector3d(normal(random), normal(random), normal(random)); };
  for (int i = 0; i < 200; ++i) {
    const Vector3d direction = any();
    if (direction.head<2>().norm() < 0.2 || std::abs(look_along(direction).pan) > 3) continue;
    const Vector3d rate = any();
    constexpr double kStep = 1e-6;
    const Vector3d later = Eigen::AngleAxisd(-rate.norm() * kStep, rate.normalized()) * direction;
    const PanTilt rates = rates_to_hold(direction, rate);
    EXPECT_NEAR(rates.pan, (look_along(later).pan - look_along(direction).pan) / kStep,
                1e-3 * (1 + std::abs(rates.pan)));
    EXPECT_NEAR(rates.tilt, (look_along(later).tilt - look_along(direction).tilt) / kStep, 1e-3);
  }
  EXPECT_EQ(rates_to_hold(kUp, kAhead).pan, 0);
}

TEST(Attitude, FindsUpAndLearnsTheBiasOfAGyroAtRest) {
  const Eigen::Quaterniond truth(Eigen::AngleAxisd(0.4, Vector3d(1, 2, 0).normalized()));
  const Vector3d bias(0.01, -0.02, 0.015);
  Attitude attitude;
  EXPECT_FALSE(attitude.is_known());
  attitude.update(bias, 3 * kUp, kPeriod);  // in free fall, nearly: it tells nothing
  EXPECT_FALSE(attitude.is_known());
  const Vector3d up = truth.conjugate() * kUp;
  for (int i = 0; i < 3'000; ++i) attitude.update(bias, 9.81 * up, kPeriod);
  EXPECT_LT(angle_between(attitude.world_from_imu().conjugate() * kUp, up), 0.1 * kDegree);
  EXPECT_LT((attitude.bias() - bias).norm(), 1e-4);
}

TEST(Backlash, AMotorToldBeforehandMakesTheAxisFollow) {
  constexpr double kPlay = 0.3 * kDegree;
  Backlash gear(kPlay);
  double most = 0;
  for (int i = 0; i < 500; ++i) {
    const double t = i * kPeriod;
    const double axis = gear.follow(gear.motor_for(0.1 * std::sin(5 * t), 0.5 * std::cos(5 * t)));
    if (i > 50) most = std::max(most, std::abs(axis - 0.1 * std::sin(5 * t)));
  }
  EXPECT_LT(most, kPlay / 10);  // half of it without
  const double there = gear.motor_for(0, 1);
  EXPECT_EQ(gear.motor_for(0, -1e-3), there);  // noise does not make it cross
}

TEST(BaseMotion, IsSeenThroughTheHeadThatTurnsOnItAndForetold) {
  const Gait gait{1.5};
  BaseMotion base;
  double worst = 0;
  for (int i = 0; i < 400; ++i) {
    const double t = i * kPeriod;
    const PanTilt angles{0.5 * std::sin(9 * t), 0.3 * std::cos(7 * t)};
    base.update(gait.world_from_base(t) * base_from_head(angles), angles, kPeriod);
    EXPECT_LT(base.world_from_base(0).angularDistance(gait.world_from_base(t)), 1e-7);
    worst = std::max(worst, base.world_from_base(0.02).angularDistance(gait.world_from_base(t + 0.02)));
  }
  EXPECT_LT(worst, 0.25 * kDegree);  // 2 degrees without
  base.update(gait.world_from_base(9), {}, 0);
  EXPECT_EQ(base.rate(0).norm(), 0);  // nobody knows
}

TEST(Kinematics, TheRateOfTheHeadIsTheDerivative) {
  const PanTilt angles{0.4, -0.3};
  const PanTilt rates{0.7, 1.1};
  constexpr double kStep = 1e-6;
  const Eigen::AngleAxisd turn(
      base_from_head(angles).conjugate() *
      base_from_head({angles.pan + rates.pan * kStep, angles.tilt + rates.tilt * kStep}));
  EXPECT_LT((turn.angle() / kStep * turn.axis() - rate_of_head(angles, rates)).norm(), 1e-5);
  EXPECT_TRUE(optical_axis(angles).isApprox(base_from_head(angles) * kAhead));
}

TEST(Pointing, TheModesAreWhatTheySay) {
  const BaseMotion base;
  const auto neutral = demands_of(pointing::Neutral{{0.1, -0.2}}, base, 0, 0);
  EXPECT_EQ(neutral[0].position, 0.1);
  EXPECT_EQ(neutral[1].position, -0.2);
  const auto jog = demands_of(pointing::Jog{{0.3, -0.4}}, base, 0, 0);
  EXPECT_FALSE(jog[0].position);
  EXPECT_EQ(jog[1].rate, -0.4);
  const auto lock = demands_of(pointing::Lock{kAhead}, base, 0, 0);  // it is not known how it stands: stay
  EXPECT_FALSE(lock[0].position);
  EXPECT_EQ(lock[0].rate, 0);
}

}  // namespace
}  // namespace cairn
