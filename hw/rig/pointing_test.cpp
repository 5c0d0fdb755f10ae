// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/pointing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hw/rig/attitude.h"
#include "hw/rig/backlash.h"
#include "hw/rig/base_motion.h"
#include "hw/rig/head_history.h"
#include "hw/rig/search_plan.h"
#include "hw/rig/target_track.h"
#include "hw/rig/test_rig.h"
#include "hw/simulated/gait.h"

namespace cairn {
namespace {

using Eigen::Vector3d;
using simulated::Gait;
using testing::angle_between;

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

TEST(Kinematics, ACameraThatSitsAskewLooksAlongItsOwnAxis) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 1000; ++i) {
    const Vector3d axis = Vector3d(1, 0.3 * unit(random), 0.3 * unit(random)).normalized();
    const PanTilt angles{3.1 * unit(random), unit(random)};
    const PanTilt back = look_along(2 * (base_from_head(angles) * axis), 0, axis);
    EXPECT_NEAR(back.pan, angles.pan, 1e-9);
    EXPECT_NEAR(back.tilt, angles.tilt, 1e-9);
  }
}

TEST(Kinematics, TheRatesThatHoldADirectionAreTheDerivatives) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal(0, 1);
  const auto any = [&] { return Vector3d{normal(random), normal(random), normal(random)}; };
  int held = 0;
  for (int i = 0; i < 400; ++i) {
    const Vector3d axis = i % 2 == 0 ? kAhead : (kAhead + 0.3 * any()).normalized();
    const Vector3d direction = any().normalized();
    const bool is_reached = std::abs(direction.z()) < 0.9 * std::hypot(axis.x(), axis.z());
    if (!is_reached || axis.x() < 0.5 || std::abs(look_along(direction, 0, axis).pan) > 3) continue;
    ++held;
    const Vector3d rate = any();
    const Vector3d moving = any();
    constexpr double kStep = 1e-6;
    const Vector3d later =
        Eigen::AngleAxisd(-rate.norm() * kStep, rate.normalized()) * (direction + kStep * moving);
    const PanTilt rates = rates_to_hold(direction, axis, rate, moving);
    const PanTilt before = look_along(direction, 0, axis);
    const PanTilt after = look_along(later, 0, axis);
    EXPECT_NEAR(rates.pan, (after.pan - before.pan) / kStep, 1e-3 * (1 + std::abs(rates.pan)));
    EXPECT_NEAR(rates.tilt, (after.tilt - before.tilt) / kStep, 1e-3 * (1 + std::abs(rates.tilt)));
  }
  EXPECT_GT(held, 200);
  EXPECT_EQ(rates_to_hold(kUp, kAhead, kAhead).pan, 0);
}

TEST(Attitude, FindsUpAndLearnsTheBiasOfAGyroAtRest) {
  const Eigen::Quaterniond truth(Eigen::AngleAxisd(0.4, Vector3d(1, 2, 0).normalized()));
  const Vector3d bias(0.01, -0.02, 0.015);
  Attitude attitude{AttitudeOptions()};
  EXPECT_FALSE(attitude.is_known());
  attitude.update(bias, 3 * kUp, kPeriod);  // in free fall, nearly: it tells nothing
  EXPECT_FALSE(attitude.is_known());
  const Vector3d up = truth.conjugate() * kUp;
  for (int i = 0; i < 3'000; ++i) attitude.update(bias, 9.81 * up, kPeriod);
  EXPECT_LT(angle_between(attitude.world_from_imu().conjugate() * kUp, up), 0.1 * kDegree);
  EXPECT_LT((attitude.bias() - bias).norm(), 1e-4);
}

TEST(Attitude, WhatTheAxesTurnItByIsNoBias) {
  const Vector3d bias(0.005, -0.01, 0.0);
  const Vector3d turning(0, 0, 0.01);  // as a head that follows its wearer, at last slowly
  Attitude attitude{AttitudeOptions()};
  for (int i = 0; i < 3'000; ++i) attitude.update(bias + turning, 9.81 * kUp, kPeriod, kPeriod * turning);
  EXPECT_LT((attitude.bias() - bias).norm(), 1e-4);
}

TEST(Attitude, WhatAWalkDoesToTheAccelerometerIsNothingInTheMean) {
  Attitude attitude{AttitudeOptions()};
  double worst = 0;
  for (int i = 0; i < 6'000; ++i) {
    const double step = std::sin(4 * std::numbers::pi * i * kPeriod);  // up and ahead at once
    attitude.update(Vector3d::Zero(), 9.80665 * kUp + Vector3d(1.5 * step, 0, 4 * step), kPeriod);
    if (i > 2'000) worst = std::max(worst, angle_between(attitude.world_from_imu() * kUp, kUp));
  }
  EXPECT_LT(worst, 0.3 * kDegree);
}

TEST(Backlash, AMotorToldBeforehandMakesTheAxisFollow) {
  constexpr double kPlay = 0.3 * kDegree;
  Backlash gear(kPlay, BacklashOptions());
  double most = 0;
  double turning = 0;
  for (int i = 0; i < 500; ++i) {
    const double t = i * kPeriod;
    const double axis = gear.follow(gear.motor_for(0.1 * std::sin(5 * t), 0.5 * std::cos(5 * t)));
    const double off = std::abs(axis - 0.1 * std::sin(5 * t));
    if (i > 50) most = std::max(most, off);
    if (i > 50 && std::abs(std::cos(5 * t)) > 0.3) turning = std::max(turning, off);
  }
  EXPECT_LT(turning, kPlay / 10);  // half of it without
  EXPECT_LT(most, kPlay / 2);
  // Neither noise makes it cross nor what a crossing itself looks like.
  const double there = gear.motor_for(0, 1);
  for (const double rate : {-1e-3, -0.07, -kPlay / 0.06}) EXPECT_EQ(gear.motor_for(0, rate), there);
  EXPECT_NE(gear.motor_for(0, -0.2), there);
  Backlash without(0, BacklashOptions());
  EXPECT_EQ(without.motor_for(0.3, 1), 0.3);
}

TEST(BaseMotion, IsSeenThroughTheHeadThatTurnsOnItAndForetold) {
  const Gait gait{1.5};
  BaseMotion base{BaseOptions()};
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

TEST(Pointing, EachModeHasItsWord) {
  for (const Pointing& pointing :
       {Pointing(pointing::Neutral()), Pointing(pointing::Jog()), Pointing(pointing::Follow()),
        Pointing(pointing::Lock()), Pointing(pointing::Fixate()), Pointing(pointing::Saccade()),
        Pointing(pointing::Search())}) {
    const PointingMode mode = mode_of(pointing);
    EXPECT_EQ(pointing_mode(to_string(mode)), mode);
  }
  EXPECT_STREQ(to_string(PointingMode::kSearch), "search");
  EXPECT_STREQ(to_string(mode_of(pointing::Fixate())), "fixate");
  EXPECT_FALSE(pointing_mode("loock"));
}

TEST(HeadHistory, TellsHowTheHeadStoodBetweenSamples) {
  using namespace std::chrono_literals;
  const MonotonicTime start{1h};
  HeadHistory history;
  EXPECT_FALSE(history.at(start));
  const auto turned = [](double angle) { return Eigen::Quaterniond(Eigen::AngleAxisd(angle, kUp)); };
  for (int i = 0; i <= 200; ++i) history.add(start + i * 10ms, {turned(0.01 * i), 0.01 * i * kUp});
  EXPECT_LT(history.at(start + 1505ms)->world_from_head.angularDistance(turned(1.505)), 1e-6);
  EXPECT_NEAR(history.at(start + 1505ms)->way.z(), 1.505, 1e-9);
  EXPECT_FALSE(history.at(start + 500ms));   // forgotten
  EXPECT_TRUE(history.at(start + 2010ms));   // as good as now
  EXPECT_FALSE(history.at(start + 2100ms));  // of the future
  history.add(start, {turned(0)});           // time ran back
  EXPECT_FALSE(history.at(start + 1505ms));
}

TEST(TargetTrack, ForetellsAPointThatTheWearerWalksPast) {
  using namespace std::chrono_literals;
  const MonotonicTime start{1h};
  const auto truth = [](double t) { return Vector3d(2, 1 - t, 0.1); };
  TargetTrack track{TargetTrackOptions()};
  EXPECT_FALSE(track.at(start));
  for (int i = 0; i < 40; ++i) track.see(start + i * 33ms, truth(0.033 * i));
  const auto late = track.at(start + 1400ms);
  EXPECT_LT(angle_between(late->target, truth(1.4)), 0.2 * kDegree);
  EXPECT_NEAR(late->rate.y(), -1, 0.05);
  track.see(start, truth(9));  // older than what is known
  EXPECT_EQ(track.at(start + 1400ms)->target, late->target);
  EXPECT_TRUE(track.is_seen(start + 1400ms));
  EXPECT_FALSE(track.is_seen(start + 9s));
  EXPECT_EQ(track.at(start + 9s)->rate.norm(), 0);  // it stays where it was
}

/// All that is looked at until the plan has been through, in order.
std::vector<Vector3d> looks(SearchPlan& plan, const SearchPlan::Reach& reach) {
  std::vector<Vector3d> looked;
  Vector3d from = kAhead;
  while (looked.empty() || plan.looked_at(reach) < 1) {
    from = plan.next(from, reach).value();
    plan.look(from);
    looked.push_back(from);
    if (looked.size() > 1000) break;
  }
  return looked;
}

TEST(SearchPlan, LooksEverywhereWithinReachOnceAndNowhereElse) {
  const auto reach = [](const Vector3d& direction) {
    const PanTilt angles = look_along(direction);
    return std::abs(angles.pan) < 1 && std::abs(angles.tilt) < 0.6;
  };
  for (const auto pattern : {pointing::Search::Pattern::kSpiral, pointing::Search::Pattern::kRaster}) {
    SearchPlan plan({pattern, {0.9, 0.7}, {}}, kAhead, SearchPlanOptions());
    const auto looked = looks(plan, reach);
    for (size_t i = 0; i < looked.size(); ++i) {
      EXPECT_TRUE(reach(looked[i]));
      for (size_t j = 0; j < i; ++j) EXPECT_GT(angle_between(looked[i], looked[j]), 0.1);
    }
    // Whatever is within reach was in the image.
    for (double pan = -0.99; pan < 1; pan += 0.1) {
      for (double tilt = -0.59; tilt < 0.6; tilt += 0.1) {
        const bool seen = std::any_of(looked.begin(), looked.end(), [&](const Vector3d& look) {
          const PanTilt at = look_along(look);
          return std::abs(at.pan - pan) < 0.45 / std::cos(tilt) && std::abs(at.tilt - tilt) < 0.35;
        });
        EXPECT_TRUE(seen) << pan << " " << tilt;
      }
    }
    EXPECT_TRUE(plan.next(kAhead, reach));  // and all over again
    EXPECT_EQ(plan.looked_at(reach), 0);
  }
  SearchPlan nowhere({}, kAhead, SearchPlanOptions());
  EXPECT_FALSE(nowhere.next(kAhead, [](const Vector3d&) { return false; }));
}

/// A map behind who has turned away is soon seen: axes at 180 deg/s take 3.3 s for it.
TEST(SearchPlan, GoesAroundAtTheSameHeightBeforeItLooksUpAndDown) {
  const auto reach = [](const Vector3d& direction) {
    const PanTilt angles = look_along(direction);
    return std::abs(angles.pan) < 155 * kDegree && std::abs(angles.tilt) < 35 * kDegree;
  };
  SearchPlan plan({pointing::Search::Pattern::kSpiral, {0.9, 0.7}, {}}, kAhead, SearchPlanOptions());
  const auto looked = looks(plan, reach);
  double way = 0;
  double widest = 0;
  size_t level = 0;
  for (; level < looked.size() && std::abs(look_along(looked[level]).tilt) < 0.01; ++level) {
    if (level > 0) way += std::abs(look_along(looked[level]).pan - look_along(looked[level - 1]).pan);
    widest = std::max(widest, std::abs(look_along(looked[level]).pan));
  }
  EXPECT_GT(widest, 140 * kDegree);
  EXPECT_LT(way, 600 * kDegree);        // 24 steps of 36 degrees to and fro
  EXPECT_GT(looked.size(), 2 * level);  // then the others
}

TEST(SearchPlan, BeginsWhereTheMapMayBe) {
  const auto everywhere = [](const Vector3d&) { return true; };
  const std::vector<Vector3d> ranked = {optical_axis({-2, 0.5}), optical_axis({1.5, -0.4})};
  SearchPlan plan({pointing::Search::Pattern::kSpiral, {0.9, 0.7}, ranked}, kAhead, SearchPlanOptions());
  const auto looked = looks(plan, everywhere);
  EXPECT_LT(angle_between(looked.at(0), ranked[0]), 0.5);
  EXPECT_LT(angle_between(looked.at(1), ranked[1]), 0.5);
  EXPECT_LT(angle_between(looked.at(2), kAhead), 0.5);  // then around where it began
}

TEST(SearchPlan, LooksAgainWhereAMapWasSeenSince) {
  const auto everywhere = [](const Vector3d&) { return true; };
  const Vector3d before = optical_axis({-2, 0.5});
  const Vector3d since = optical_axis({1.5, 0});
  const auto is_next = [&](SearchPlan& plan, const Vector3d& direction) {
    return angle_between(plan.next(kAhead, everywhere).value(), direction) < 0.5;
  };
  SearchPlan plan({pointing::Search::Pattern::kSpiral, {0.9, 0.7}, {before}}, kAhead, SearchPlanOptions());
  plan.look(before);
  plan.look(since);
  plan.rank({before});
  EXPECT_FALSE(is_next(plan, before)) << "it was no more than told again";
  plan.rank({since, before});
  EXPECT_TRUE(is_next(plan, since));
  plan.look(since);
  EXPECT_FALSE(is_next(plan, before));
}

}  // namespace
}  // namespace cairn
