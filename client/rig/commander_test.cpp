// SPDX-License-Identifier: Apache-2.0
#include "client/rig/commander.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace cairn {
namespace {

using namespace std::chrono_literals;
using Eigen::Vector3d;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using wire::RigAxisCondition;
using wire::RigMode;

/// A rig that does what it is told, and the tracker, 100 steps a second.
class Commander : public ::testing::Test {
 protected:
  void SetUp() override { set(RigAxisCondition::kActive); }
  void set(RigAxisCondition condition) {
    for (auto& axis : rig_.axes) axis.condition = condition;
  }
  /// What the rig hears.
  std::optional<wire::RigCommand> step(RigCommander& commander) {
    now_ += slower_ * 10ms;
    host_ = host_ + 10ms;
    rig_.time = rig_.imu.time = host_;
    rig_.has_imu = rig_.imu.attitude_known = true;
    rig_.imu.world_from_head = Eigen::AngleAxisd(heading_, Vector3d::UnitZ());
    if (is_there_) commander.hear(rig_, now_);
    const auto order = commander.command(now_);
    if (order && order->order != rig_.order) {
      rig_.order = order->order;
      rig_.mode = order->mode;
      rig_.drives_idle = order->mode == RigMode::kIdle || order->mode == RigMode::kStop;
      if (order->mode == RigMode::kStop) rig_.stopped = true;
      if (order->mode == RigMode::kClearStop) rig_.stopped = false;
      if (order->mode == RigMode::kHome) set(RigAxisCondition::kHoming);
      ++orders_;
    }
    return order;
  }
  wire::RigCommand after(RigCommander& commander, RigSight sight, std::chrono::milliseconds time) {
    std::optional<wire::RigCommand> order;
    for (; time > 0ms; time -= 10ms) {
      order = step(commander);
      sight.time = host_;
      commander.see(sight);
    }
    order = step(commander);
    EXPECT_TRUE(order);
    return order.value_or(wire::RigCommand());
  }
  [[nodiscard]] RigCommander make(RigAim aim) const {
    return {"shoulder", "eye", {7}, aim, wire::RigSearchPattern::kSpiral, CommanderOptions()};
  }
  [[nodiscard]] Timestamp time() const { return host_; }

  const RigSight tracked_ = [] {
    RigSight sight;
    sight.tracked = true;
    return sight;
  }();
  const RigSight lost_ = [] {
    RigSight sight;
    sight.lost = true;
    return sight;
  }();
  MonotonicTime now_{std::chrono::hours(1)};
  Timestamp host_{int64_t{3'600'000'000'000}};  ///< of frames and the rig
  int slower_ = 1;                              ///< than now_ it goes
  wire::RigState rig_;
  double heading_ = 0;
  bool is_there_ = true;
  int orders_ = 0;
};

TEST_F(Commander, SaysNothingToNobodyAndSaysThatNobodyIsThere) {
  RigCommander commander = make(RigAim::kLock);
  is_there_ = false;
  EXPECT_FALSE(step(commander));
  EXPECT_THAT(commander.describe(now_), HasSubstr("rig shoulder: is not there"));
  is_there_ = true;
  EXPECT_TRUE(step(commander));
  is_there_ = false;
  for (int i = 0; i < 200; ++i) (void)step(commander);
  EXPECT_FALSE(step(commander));
  EXPECT_THAT(commander.describe(now_), HasSubstr("silent"));
}

TEST_F(Commander, ARigThatIsNotHomedIsHomedLooksAheadAndIsThenAimed) {
  RigCommander commander = make(RigAim::kFollow);
  set(RigAxisCondition::kUnknown);
  EXPECT_EQ(after(commander, tracked_, 200ms).mode, RigMode::kHome);
  EXPECT_EQ(orders_, 1);
  set(RigAxisCondition::kIdle);
  EXPECT_EQ(after(commander, tracked_, 200ms).mode, RigMode::kNeutral) << "homing ends where the stops are";
  rig_.on_target = true;
  const auto order = after(commander, tracked_, 200ms);
  EXPECT_EQ(order.mode, RigMode::kFollow);
  EXPECT_EQ(order.rig, "shoulder");
  EXPECT_EQ(order.commander, "eye");
  EXPECT_EQ(orders_, 3);
}

TEST_F(Commander, ALostCameraSearchesWhereItWasTrackedLastLooksAtAPlaceAndIsThenAsBefore) {
  RigCommander commander = make(RigAim::kFollow);
  heading_ = 0.5;
  EXPECT_EQ(after(commander, tracked_, 500ms).mode, RigMode::kFollow);
  heading_ = 2;
  EXPECT_EQ(after(commander, lost_, 200ms).mode, RigMode::kFollow);  // a hand before the lens
  const auto search = after(commander, lost_, 200ms);
  EXPECT_EQ(search.mode, RigMode::kSearch);
  EXPECT_LT((search.target - Vector3d(std::cos(0.5), std::sin(0.5), 0)).norm(), 1e-9);
  heading_ = 1;
  (void)after(commander, lost_, 100ms);
  const Timestamp asked = time();
  heading_ = 1.5;
  (void)after(commander, lost_, 100ms);
  commander.try_place(asked);
  const auto look = after(commander, lost_, 100ms);
  EXPECT_EQ(look.mode, RigMode::kLock);  // turned back to where that image was taken
  EXPECT_LT((look.target - Vector3d(std::cos(1), std::sin(1), 0)).norm(), 1e-9);
  RigSight verifying = lost_;
  verifying.verifying = true;
  EXPECT_EQ(after(commander, verifying, 1000ms).mode, RigMode::kLock);  // as long as it takes
  EXPECT_EQ(after(commander, lost_, 500ms).mode, RigMode::kSearch);     // it failed
  commander.try_place(time());
  (void)after(commander, verifying, 100ms);
  EXPECT_EQ(after(commander, tracked_, 100ms).mode, RigMode::kFollow);
  EXPECT_EQ(commander.counts().searches, 1);
  EXPECT_EQ(commander.counts().candidates, 2);
}

/// At 180 deg/s 50 ms are 9 degrees.
TEST_F(Commander, APlaceIsLookedAtWhereItsImageWasTakenAlsoByAnotherClock) {
  constexpr double kRate = std::numbers::pi;  // [rad/s]
  constexpr auto kOffset = 50ms;
  const auto looks_at = [&](const std::function<void()>& tell_offset) {
    rig_ = {};
    SetUp();
    tell_offset();
    RigCommander commander = make(RigAim::kSearch);
    heading_ = 0;
    Timestamp asked;
    double seen = 0;
    for (int i = 0; i < 40; ++i) {
      heading_ += 0.01 * kRate;
      (void)step(commander);
      if (i == 25) {
        asked = host_ + -kOffset;  // by the camera's clock
        seen = heading_;
      }
    }
    commander.see(lost_);
    commander.try_place(asked);
    const auto order = step(commander).value_or(wire::RigCommand());
    EXPECT_EQ(order.mode, RigMode::kLock);
    return std::atan2(order.target.y(), order.target.x()) - seen;
  };
  const auto ns = std::chrono::nanoseconds(kOffset).count();
  EXPECT_NEAR(looks_at([&] { rig_.calibrated_offset = ns; }), 0, 1e-6);
  EXPECT_NEAR(looks_at([&] {
                rig_.calibrated_offset = 0;
                rig_.camera_clock = {true, ns, 0.001F};
              }),
              0, 1e-6)
      << "what was estimated at work counts first";
  EXPECT_NEAR(looks_at([] {}), -0.05 * kRate, 1e-6) << "nothing is known of another clock";
}

TEST_F(Commander, ASearchGoesOnWhereEachMapWasSeenLastTheNewestFirst) {
  RigCommander commander("shoulder", "eye", {7}, RigAim::kFollow, wire::RigSearchPattern::kRaster,
                         CommanderOptions());
  const auto tracked_in = [&](uint8_t map, double heading) {
    RigSight sight = tracked_;
    sight.map.bytes[0] = map;
    heading_ = heading;
    (void)after(commander, sight, 100ms);
  };
  tracked_in(1, 0.1);
  tracked_in(2, 0.2);
  tracked_in(1, 0.3);
  const auto headings = [](const wire::RigCommand& order) {
    std::vector<double> all = {std::atan2(order.target.y(), order.target.x())};
    for (const Vector3d& direction : order.further) all.push_back(std::atan2(direction.y(), direction.x()));
    return all;
  };
  const auto search = after(commander, lost_, 400ms);
  EXPECT_EQ(search.mode, RigMode::kSearch);
  EXPECT_EQ(search.pattern, wire::RigSearchPattern::kRaster);
  EXPECT_THAT(headings(search), ElementsAre(DoubleNear(0.3, 1e-9), DoubleNear(0.2, 1e-9)));
  for (uint8_t map = 1; map <= 20; ++map) tracked_in(map, 0.1 * map);
  const auto bounded = headings(after(commander, lost_, 400ms));
  ASSERT_EQ(bounded.size(), wire::kMaxFurtherDirections + 1);
  EXPECT_NEAR(bounded.front(), 2.0, 1e-9);
  EXPECT_NEAR(bounded.back(), 1.3, 1e-9);
}

TEST_F(Commander, NeutralLeavesTheCameraToTheWearerAndSearchHoldsWhatItFinds) {
  RigCommander neutral = make(RigAim::kNeutral);
  EXPECT_EQ(after(neutral, lost_, 1000ms).mode, RigMode::kNeutral);
  neutral.try_place(time());
  EXPECT_EQ(after(neutral, lost_, 100ms).mode, RigMode::kNeutral);
  RigCommander search = make(RigAim::kSearch);
  EXPECT_EQ(after(search, lost_, 50ms).mode, RigMode::kSearch);
  orders_ = 0;
  EXPECT_EQ(after(search, tracked_, 500ms).mode, RigMode::kLock);
  EXPECT_EQ(orders_, 1);
}

/// At the edge of a map a few of its points are in sight.
TEST_F(Commander, ASearchGoesPastAPoorViewToAGoodOne) {
  RigCommander search = make(RigAim::kSearch);
  RigSight poor = tracked_;
  poor.poor = true;
  rig_.looked_at = 0.2;
  EXPECT_EQ(after(search, lost_, 100ms).mode, RigMode::kSearch);
  rig_.looked_at = 0.4;
  EXPECT_EQ(after(search, poor, 300ms).mode, RigMode::kSearch);
  rig_.looked_at = 0.6;
  EXPECT_EQ(after(search, lost_, 100ms).mode, RigMode::kSearch);
  EXPECT_EQ(after(search, tracked_, 100ms).mode, RigMode::kLock);
  EXPECT_EQ(after(search, poor, 1000ms).mode, RigMode::kLock) << "who is found is not led away";
}

TEST_F(Commander, ASearchComesBackToAPoorViewWhenARoundHasShownNoBetter) {
  RigCommander search = make(RigAim::kSearch);
  RigSight poor = tracked_;
  poor.poor = true;
  rig_.looked_at = 0.4;
  heading_ = 0.5;
  (void)after(search, lost_, 100ms);
  EXPECT_EQ(after(search, poor, 100ms).mode, RigMode::kSearch);
  rig_.looked_at = 0.9;
  heading_ = 2;
  EXPECT_EQ(after(search, lost_, 500ms).mode, RigMode::kSearch);
  rig_.looked_at = 0;
  const auto back = after(search, lost_, 50ms);
  EXPECT_EQ(back.mode, RigMode::kLock);
  EXPECT_LT((back.target - Vector3d(std::cos(0.5), std::sin(0.5), 0)).norm(), 1e-9);
  heading_ = 0.5;
  const auto held = after(search, poor, 1000ms);
  EXPECT_EQ(held.mode, RigMode::kLock);
}

TEST_F(Commander, ASightingIsToldWithTheStampOfItsImageAndIsNoNewOrder) {
  RigCommander commander = make(RigAim::kFixate);
  EXPECT_EQ(after(commander, tracked_, 100ms).target.norm(), 0);
  orders_ = 0;
  RigSight sight = tracked_;
  sight.target = Vector3d(0.1, 0, 2);
  const auto order = after(commander, sight, 200ms);
  EXPECT_EQ(order.target, *sight.target);
  EXPECT_EQ(order.seen.nanoseconds, host_.nanoseconds - 10'000'000);
  EXPECT_EQ(orders_, 0);
}

TEST_F(Commander, AStopIsSaidUntilItIsObeyedAndNothingMovesUntilSomebodyWantsIt) {
  RigCommander commander = make(RigAim::kLock);
  EXPECT_EQ(after(commander, tracked_, 100ms).mode, RigMode::kLock);
  commander.stop();
  EXPECT_TRUE(commander.is_urgent());
  EXPECT_EQ(step(commander)->mode, RigMode::kStop);
  EXPECT_FALSE(commander.is_urgent());
  EXPECT_EQ(after(commander, tracked_, 2000ms).mode, RigMode::kIdle);
  EXPECT_FALSE(commander.is_urgent()) << "it was obeyed";
  EXPECT_THAT(commander.describe(now_), HasSubstr("EMERGENCY STOP"));
  commander.clear();
  EXPECT_EQ(step(commander)->mode, RigMode::kClearStop);
  EXPECT_EQ(after(commander, lost_, 2000ms).mode, RigMode::kIdle);
  commander.want(RigAim::kFollow);
  EXPECT_EQ(after(commander, tracked_, 100ms).mode, RigMode::kFollow);
  rig_.stopped = true;  // by somebody else, who clears it too
  (void)after(commander, tracked_, 100ms);
  rig_.stopped = false;
  EXPECT_EQ(after(commander, tracked_, 2000ms).mode, RigMode::kIdle);
}

TEST_F(Commander, WhatIsRefusedIsToldAndTriedAgainAndAFaultWaitsForAPerson) {
  RigCommander commander = make(RigAim::kLock);
  (void)after(commander, tracked_, 100ms);
  rig_.refusal = "the rig is commanded by operator-1";
  orders_ = 0;
  (void)after(commander, tracked_, 3000ms);
  EXPECT_THAT(commander.describe(now_), HasSubstr("commanded by operator-1"));
  EXPECT_GE(orders_, 2);
  EXPECT_LE(orders_, 4);
  rig_.refusal = {};
  rig_.axes[0].fault = 3;
  rig_.axes[0].condition = RigAxisCondition::kFaulted;
  rig_.drives_idle = true;
  rig_.trouble = "pan does not follow";
  orders_ = 0;
  (void)after(commander, tracked_, 3000ms);
  EXPECT_EQ(orders_, 0);
  EXPECT_THAT(commander.describe(now_), HasSubstr("pan does not follow"));
}

TEST_F(Commander, TimesAreThoseOfTheRigsClockAlsoWhereThatIsSlowed) {
  slower_ = 50;  // half a second between states
  RigCommander commander = make(RigAim::kLock);
  set(RigAxisCondition::kHoming);
  (void)after(commander, tracked_, 100ms);
  set(RigAxisCondition::kIdle);
  EXPECT_EQ(after(commander, tracked_, 2900ms).mode, RigMode::kNeutral) << "it looks ahead for three seconds";
  EXPECT_EQ(after(commander, tracked_, 200ms).mode, RigMode::kLock);
  rig_.refusal = "the rig is commanded by operator-1";
  orders_ = 0;
  (void)after(commander, tracked_, 3000ms);
  EXPECT_GE(orders_, 2) << "once a second";
  EXPECT_LE(orders_, 4);
  now_ += 4s;
  EXPECT_TRUE(commander.command(now_)) << "eight states are late";
  now_ += 10s;
  EXPECT_THAT(commander.describe(now_), HasSubstr("silent"));
  slower_ = 1;
  (void)after(commander, tracked_, 100ms);
  now_ += 1500ms;
  EXPECT_THAT(commander.describe(now_), HasSubstr("silent")) << "after states that came fast again";
}

TEST_F(Commander, AClockThatWasSetBackHoldsUpNoOrder) {
  RigCommander commander = make(RigAim::kLock);
  (void)after(commander, tracked_, 100ms);
  rig_.refusal = "no";
  host_ = host_ + -30min;
  orders_ = 0;
  (void)after(commander, tracked_, 2500ms);
  EXPECT_GE(orders_, 2);
}

TEST_F(Commander, AStopIsSaidToARigThatIsNotHeard) {
  RigCommander commander = make(RigAim::kLock);
  is_there_ = false;
  EXPECT_FALSE(step(commander));
  commander.stop();
  EXPECT_EQ(step(commander).value_or(wire::RigCommand()).mode, RigMode::kStop);
}

TEST_F(Commander, WhatHaltedAfterTheOrderOfAnotherIsOrderedAgain) {
  RigCommander commander = make(RigAim::kLock);
  (void)after(commander, tracked_, 200ms);
  const auto before = orders_;
  rig_.order = {{9}, 1};  // refused, but judged last
  rig_.drives_idle = true;
  EXPECT_EQ(after(commander, tracked_, 1500ms).mode, RigMode::kLock);
  EXPECT_GT(orders_, before);
}

TEST_F(Commander, DirectionsOfAClockThatWasSetBackAreForgotten) {
  RigCommander commander = make(RigAim::kFollow);
  (void)after(commander, tracked_, 500ms);
  host_ = host_ + -10s;
  heading_ = 1;
  (void)after(commander, tracked_, 100ms);
  const auto order = after(commander, lost_, 600ms);
  EXPECT_EQ(order.mode, RigMode::kSearch);
  EXPECT_NEAR(order.target.y(), std::sin(1.0), 1e-6) << "where it was tracked last";
}

TEST_F(Commander, AtTheEndTheDrivesAreLetGo) {
  RigCommander commander = make(RigAim::kLock);
  (void)after(commander, tracked_, 100ms);
  commander.close();
  EXPECT_FALSE(commander.is_over());
  EXPECT_EQ(step(commander)->mode, RigMode::kIdle);
  (void)step(commander);
  EXPECT_TRUE(commander.is_over());
}

TEST(CommanderOptionsTest, DefaultsAreInTheirRangesAndEachMemberIsListedOnce) {
  CommanderOptions options;
  const Status checked = check_options(options);
  EXPECT_TRUE(checked) << checked.error().message;
  const Status complete = list_options(&options).check_complete();
  EXPECT_TRUE(complete) << complete.error().message;
}

}  // namespace
}  // namespace cairn
