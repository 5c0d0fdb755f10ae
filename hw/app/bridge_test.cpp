// SPDX-License-Identifier: Apache-2.0
#include "hw/app/bridge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <numbers>

#include "hw/app/bridge_bench.h"
#include "hw/app/scaled_clock.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::BridgeBench;
using ::testing::Contains;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using testing::order_of;
using wire::RigAxisCondition;
using wire::RigMode;
using wire::RigState;

constexpr double kDegree = std::numbers::pi / 180;

bool is_idle(const RigState& state) {
  return state.drives_idle;
}

/// Homed, then told to look somewhere, and there.
class Bridge : public ::testing::Test {
 protected:
  void begin() {
    ASSERT_NO_FATAL_FAILURE(bench_.home());
    auto look = order_of(1, 2, RigMode::kSaccade);
    look.angles = {20 * kDegree, -5 * kDegree};
    bench_.order(look);
    ASSERT_EQ(bench_.state().refusal, "");
    ASSERT_TRUE(bench_.until(
        [](const RigState& state) {
          return std::abs(state.axes[0].position - 20 * kDegree) < 0.03 &&
                 std::abs(state.axes[1].position + 5 * kDegree) < 0.03;
        },
        3s));
  }
  BridgeBench bench_;
};

TEST_F(Bridge, AnOrderMovesTheAxesAndTheStateTellsIt) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const RigState state = bench_.state();
  EXPECT_EQ(state.rig, "shoulder");
  EXPECT_EQ(state.mode, RigMode::kSaccade);
  EXPECT_EQ(state.commander, "tracker-1");
  EXPECT_EQ(state.axes[0].condition, RigAxisCondition::kActive);
  EXPECT_FALSE(state.drives_idle);
  EXPECT_EQ(state.trouble, "");
  EXPECT_TRUE(state.has_imu);
  EXPECT_NEAR(state.imu.acceleration.norm(), 9.81, 0.3);
}

TEST_F(Bridge, WithoutItsCommanderItLetsTheDrivesGoAndTheOldOrderDoesNotStartThemAgain) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto order = bench_.said_again;
  bench_.said_again.reset();
  const auto time = bench_.until(is_idle, 200ms);
  ASSERT_TRUE(time);
  EXPECT_LE(*time, 100ms);
  EXPECT_EQ(bench_.state().mode, RigMode::kIdle);
  EXPECT_THAT(bench_.state().trouble, HasSubstr("the commander fell silent"));
  bench_.order(*order);
  bench_.pass(500ms);
  EXPECT_TRUE(bench_.state().drives_idle);
  auto anew = *order;
  anew.order.seq = 3;
  bench_.order(anew);
  bench_.pass(500ms);
  EXPECT_FALSE(bench_.state().drives_idle);
  EXPECT_EQ(bench_.state().trouble, "");
}

TEST_F(Bridge, WhatIsWrongWithTheBusIsToldFirst) {
  bench_.bridge().set_bus_trouble("can0: the interface is down");
  bench_.pass(10ms);
  EXPECT_EQ(bench_.state().trouble, "can0: the interface is down");
  bench_.devices().inject(DeviceFault::kMutePan, std::nullopt, bench_.now());
  bench_.pass(300ms);
  EXPECT_THAT(bench_.state().trouble, ::testing::StartsWith("can0: the interface is down. pan (node 16)"));
}

TEST_F(Bridge, WhoOrderedIsToldAlsoWhereItIsRefused) {
  EXPECT_EQ(bench_.state().ordered_by, "");
  ASSERT_NO_FATAL_FAILURE(begin());
  EXPECT_EQ(bench_.state().ordered_by, "tracker-1");
  EXPECT_EQ(bench_.state().ordered, RigMode::kSaccade);
  bench_.bridge().obey(order_of(2, 1, RigMode::kNeutral), bench_.now());
  EXPECT_EQ(bench_.state().ordered_by, "tracker-2");
  EXPECT_EQ(bench_.state().ordered, RigMode::kNeutral);
  EXPECT_EQ(bench_.state().commander, "tracker-1");
}

/// The tracker of the camera uses them: each comes in two states at least, as the IMU measured it.
TEST_F(Bridge, EachSampleOfTheImuIsToldTwiceInOrder) {
  ASSERT_NO_FATAL_FAILURE(begin());
  std::map<int64_t, int> told;
  const Timestamp before = bench_.state().samples.back().time;
  Timestamp newest;
  for (int i = 0; i < 100; ++i) {
    bench_.pass(10ms);
    const RigState state = bench_.state();
    ASSERT_FALSE(state.samples.empty());
    EXPECT_LT(seconds_between(state.time, state.samples.back().time), 0.015);
    for (size_t k = 0; k < state.samples.size(); ++k) {
      ASSERT_TRUE(k == 0 || state.samples[k - 1].time < state.samples[k].time);
      if (state.samples[k].time > before) ++told[state.samples[k].time.nanoseconds];
    }
    EXPECT_EQ(state.samples.back().rate, state.imu.rate);
    EXPECT_EQ(state.samples.back().acceleration, state.imu.acceleration);
    newest = state.samples.back().time;
  }
  EXPECT_GE(told.size(), 99U);
  for (const auto& [time, count] : told)
    EXPECT_TRUE(count >= 2 || newest.nanoseconds - time < 20'000'000) << time;
}

/// What the configuration says nothing of is not made up.
TEST_F(Bridge, HowTheImuSitsIsToldWhereTheConfigurationKnows) {
  EXPECT_FALSE(bench_.state().camera_from_imu);
  EXPECT_FALSE(bench_.state().calibrated_offset);
  const auto state_with = [](const std::string& calibration) {
    const RigBridge bridge(testing::read_rig(testing::kRigText + calibration).value(), {});
    return bridge.state({});
  };
  const RigState of_half = state_with("calibration: {camera: [0, 0, 0], offset: 2.5}\n");
  EXPECT_FALSE(of_half.camera_from_imu);
  EXPECT_EQ(of_half.calibrated_offset, 2'500'000);
  const RigState of_all = state_with("calibration: {camera: [0, 0, 0], imu: [0, 0, 90], offset: 0}\n");
  ASSERT_TRUE(of_all.camera_from_imu);
  // Its x is the head's y then, left, which is the camera's -x.
  EXPECT_TRUE((*of_all.camera_from_imu * Eigen::Vector3d::UnitX()).isApprox(-Eigen::Vector3d::UnitX()));
  EXPECT_EQ(of_all.calibrated_offset, 0);
  EXPECT_FALSE(of_all.base_from_camera) << "nothing is homed";
}

TEST_F(Bridge, WhereTheEncodersHaveTheCameraIsTold) {
  EXPECT_FALSE(bench_.state().base_from_camera);
  ASSERT_NO_FATAL_FAILURE(begin());
  const RigState state = bench_.state();
  ASSERT_TRUE(state.base_from_camera);
  const Eigen::Vector3d axis = *state.base_from_camera * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(std::atan2(axis.y(), axis.x()), 20 * kDegree, 0.04);
  EXPECT_NEAR(std::asin(axis.z()), -5 * kDegree, 0.04);
}

/// An image of the future tells nothing, unless its stamp is known to be late.
TEST_F(Bridge, TheOffsetOfTheCamerasClockIsToldAndCountsForWhatIsSeenFromThenOn) {
  ASSERT_NO_FATAL_FAILURE(begin());
  auto fixate = order_of(1, 3, RigMode::kFixate);
  bench_.order(fixate);
  bench_.said_again.reset();
  int64_t image = 0;
  const auto see = [&] {
    for (int i = 0; i < 10; ++i) {
      fixate.seen = {++image};
      fixate.target = {0, 0, 2};
      bench_.bridge().obey(fixate, bench_.now(), bench_.now() + 170ms);
      bench_.pass(20ms);
    }
    return bench_.state();
  };
  const RigState before = see();
  EXPECT_FALSE(before.sees_target);
  EXPECT_FALSE(before.camera_clock.known);
  bench_.bridge().set_camera_clock({true, -200'000'000, 0.001F});
  const RigState after = see();
  EXPECT_TRUE(after.sees_target);
  EXPECT_TRUE(after.camera_clock.known);
  EXPECT_EQ(after.camera_clock.offset, -200'000'000);
  bench_.bridge().set_camera_clock({});
  bench_.pass(1s);  // sightings of before are forgotten
  const RigState withdrawn = see();
  EXPECT_FALSE(withdrawn.sees_target) << "what the configuration says counts again";
  EXPECT_FALSE(withdrawn.camera_clock.known);
}

TEST_F(Bridge, ASecondCommanderIsRefusedByNameAndDoesNotMoveAnythingLater) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto intruder = order_of(2, 1, RigMode::kNeutral);
  bench_.bridge().obey(intruder, bench_.now());
  EXPECT_THAT(bench_.state().refusal, HasSubstr("tracker-1"));
  EXPECT_EQ(bench_.state().order, intruder.order);
  bench_.pass(200ms);
  EXPECT_EQ(bench_.state().mode, RigMode::kSaccade);
  bench_.said_again = intruder;  // goes on, while the first falls silent
  bench_.pass(500ms);
  EXPECT_TRUE(bench_.state().drives_idle);
}

TEST_F(Bridge, OneThatIsReservedIsNobodyElsesToMoveButAnybodysToStop) {
  bench_.bridge().reserve_for({1});
  ASSERT_NO_FATAL_FAILURE(begin());
  for (const RigMode mode : {RigMode::kIdle, RigMode::kHome, RigMode::kFollow, RigMode::kClear}) {
    bench_.bridge().obey(order_of(2, static_cast<uint64_t>(mode) + 1, mode), bench_.now());
    EXPECT_THAT(bench_.state().refusal, HasSubstr("being calibrated")) << wire::name_of(mode);
  }
  EXPECT_FALSE(bench_.state().drives_idle);
  bench_.bridge().obey(order_of(2, 20, RigMode::kStop), bench_.now());
  EXPECT_TRUE(bench_.state().stopped);
}

TEST_F(Bridge, TwoProcessesOfOneNameAreTwoCommanders) {
  ASSERT_NO_FATAL_FAILURE(begin());
  auto namesake = order_of(2, 1, RigMode::kNeutral);
  namesake.commander = "tracker-1";
  bench_.bridge().obey(namesake, bench_.now());
  EXPECT_THAT(bench_.state().refusal, HasSubstr("tracker-1"));
  EXPECT_EQ(bench_.state().mode, RigMode::kSaccade);
}

TEST_F(Bridge, WhatIsRefusedChangesNothingAndItsCommanderIsStillThere) {
  ASSERT_NO_FATAL_FAILURE(begin());
  bench_.order(order_of(1, 3, RigMode::kHome));
  EXPECT_THAT(bench_.state().refusal, HasSubstr("only an idle axis"));
  bench_.pass(500ms);
  EXPECT_EQ(bench_.state().mode, RigMode::kSaccade);
  EXPECT_FALSE(bench_.state().drives_idle);
}

/// The engine's tests say how well each does what it is for.
TEST_F(Bridge, EachModeIsToldOnAndItsTargetMovesWithoutAnotherOrder) {
  ASSERT_NO_FATAL_FAILURE(begin());
  uint64_t number = 3;
  for (const RigMode mode : {RigMode::kNeutral, RigMode::kFollow, RigMode::kLock, RigMode::kFixate,
                             RigMode::kSaccade, RigMode::kSearch, RigMode::kJog}) {
    bench_.order(order_of(1, number++, mode));
    EXPECT_EQ(bench_.state().refusal, "") << wire::name_of(mode);
    bench_.pass(100ms);
    EXPECT_EQ(bench_.state().mode, mode);
  }
  auto lock = order_of(1, number++, RigMode::kLock);
  lock.target = {1, 0, 0};
  bench_.order(lock);
  bench_.pass(100ms);
  const auto is_there = [](const RigState& state) { return state.on_target; };
  ASSERT_TRUE(bench_.until(is_there, 3s));
  const double before = bench_.state().axes[0].position;
  bench_.said_again->target = {std::cos(0.5), std::sin(0.5), 0};
  bench_.pass(100ms);
  EXPECT_FALSE(bench_.state().on_target);
  ASSERT_TRUE(bench_.until(is_there, 3s));
  EXPECT_NEAR(bench_.state().axes[0].position - before, 0.5, 0.02);
}

TEST_F(Bridge, ASearchLooksAtRankedDirectionsFirstAndThenAsItIsTold) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto heading = [](double pan) { return Eigen::Vector3d(std::cos(pan), std::sin(pan), 0); };
  auto search = order_of(1, 3, RigMode::kSearch);
  search.target = heading(0.6);
  search.further = {heading(-0.6)};
  bench_.order(search);
  const auto looks_at = [&](double pan) {
    return bench_.until(
        [&](const RigState& state) {
          return std::abs(state.axes[0].position - pan) < 0.25 && state.on_target;
        },
        3s);
  };
  EXPECT_TRUE(looks_at(0.6));
  EXPECT_TRUE(looks_at(-0.6)) << "then at the second";
  const auto has_looked = [](const RigState& state) { return state.looked_at > 0.6F; };
  ASSERT_TRUE(bench_.until(has_looked, 10s));
  const auto goes_on = [&](uint64_t number, wire::RigSearchPattern pattern) {
    auto anew = order_of(1, number, RigMode::kSearch);
    anew.pattern = pattern;
    bench_.order(anew);
    bench_.pass(50ms);
    return has_looked(bench_.state());
  };
  EXPECT_TRUE(goes_on(4, wire::RigSearchPattern::kSpiral));
  EXPECT_FALSE(goes_on(5, wire::RigSearchPattern::kRaster)) << "another order of places: looked at anew";
}

TEST_F(Bridge, WhatTheCameraSeesIsFixated) {
  ASSERT_NO_FATAL_FAILURE(begin());
  auto fixate = order_of(1, 3, RigMode::kFixate);
  fixate.target = {0, 0, 2};  // straight ahead
  bench_.order(fixate);
  const auto see = [this](const Eigen::Vector3d& target) {
    bench_.said_again->target = target;
    bench_.said_again->seen = {bench_.now().time_since_epoch().count()};
    bench_.pass(40ms);
  };
  for (int i = 0; i < 5; ++i) see({0, 0, 2});
  EXPECT_TRUE(bench_.state().sees_target);
  EXPECT_NEAR(bench_.state().axes[0].position, 20 * kDegree, 0.06);
  // To the left, wherever the camera turns: it turns on.
  for (int i = 0; i < 10; ++i) see({-0.4, 0, 2});
  EXPECT_GT(bench_.state().axes[0].position, 25 * kDegree);
}

TEST_F(Bridge, AnybodyMayStopItUntilItsNameClearsThat) {
  ASSERT_NO_FATAL_FAILURE(begin());
  bench_.bridge().obey(order_of(9, 1, RigMode::kStop), bench_.now());
  EXPECT_TRUE(bench_.state().stopped);
  EXPECT_EQ(bench_.state().mode, RigMode::kStop);
  bench_.pass(50ms);
  EXPECT_THAT(bench_.told, Contains(ContainsRegex("pan idle")).Times(2)) << "homed, then stopped";
  bench_.order(order_of(1, 3, RigMode::kNeutral));
  EXPECT_THAT(bench_.state().refusal, HasSubstr("clear the emergency stop"));
  bench_.order(order_of(9, 2, RigMode::kClearStop));
  EXPECT_EQ(bench_.state().refusal, "") << "its commander speaks on";
  bench_.pass(500ms);
  EXPECT_FALSE(bench_.state().stopped);
  EXPECT_TRUE(bench_.state().drives_idle);
  EXPECT_EQ(bench_.state().trouble, "");
}

TEST_F(Bridge, ASignalStopsIt) {
  ASSERT_NO_FATAL_FAILURE(begin());
  bench_.bridge().stop(bench_.now());
  EXPECT_TRUE(bench_.state().stopped);
}

TEST_F(Bridge, AtTheEndTheDrivesHaveSaidThatTheyAreIdle) {
  ASSERT_NO_FATAL_FAILURE(begin());
  bench_.bridge().close(bench_.now());
  EXPECT_FALSE(bench_.bridge().is_let_go(bench_.now()));
  const auto time =
      bench_.until([&](const RigState&) { return bench_.bridge().is_let_go(bench_.now()); }, 500ms);
  ASSERT_TRUE(time);
  EXPECT_THAT(bench_.told.back(), HasSubstr("idle"));
  bench_.order(order_of(1, 3, RigMode::kNeutral));
  EXPECT_THAT(bench_.state().refusal, HasSubstr("ending"));
}

TEST_F(Bridge, AnOrderToAnotherRigIsNone) {
  auto order = order_of(1, 1, RigMode::kStop);
  order.rig = "head";
  bench_.bridge().obey(order, bench_.now());
  EXPECT_FALSE(bench_.state().stopped);
}

TEST_F(Bridge, AnAxisThatDoesNotAnswerIsNamedWithItsNode) {
  bench_.devices().inject(DeviceFault::kMutePan, std::nullopt, bench_.now());
  bench_.pass(300ms);
  EXPECT_THAT(bench_.state().trouble, HasSubstr("pan (node 16) does not answer"));
  EXPECT_EQ(bench_.state().axes[0].condition, RigAxisCondition::kFaulted);
  EXPECT_EQ(bench_.state().axes[0].fault, 1);
}

/// All the way: the gyro feels it, the axes make up for it, and the camera's truth tells.
TEST_F(Bridge, TheWearerOfSimulatedDevicesWalksAndTurnsAsToldAndLockHoldsTheCamera) {
  ASSERT_NO_FATAL_FAILURE(begin());
  bench_.order(order_of(1, 3, RigMode::kLock));
  bench_.pass(10s);  // the gyro's bias is learnt
  const Eigen::Vector3d axis = bench_.devices().world_from_camera().rotation() * Eigen::Vector3d::UnitZ();
  const auto off = [&] {
    const Eigen::Vector3d now = bench_.devices().world_from_camera().rotation() * Eigen::Vector3d::UnitZ();
    return std::atan2(now.cross(axis).norm(), now.dot(axis));
  };
  const double before = bench_.state().axes[0].position;
  ASSERT_TRUE(bench_.devices().obey("turn 20 1.5", bench_.now()));
  bench_.pass(2s);
  EXPECT_LT(off(), 1 * kDegree);
  EXPECT_NEAR(bench_.state().axes[0].position, before - 20 * kDegree, 1 * kDegree);
  ASSERT_TRUE(bench_.devices().obey("walk 0.5 10", bench_.now()));
  bench_.pass(1s);
  const double begun = bench_.devices().world_from_camera().translation().x();
  bench_.pass(3s);
  EXPECT_GT(bench_.devices().world_from_camera().translation().x(), begun + 0.1);
  ASSERT_TRUE(bench_.devices().obey("stand", bench_.now()));
  bench_.pass(1500ms);
  bench_.said_again.reset();
}

/// A tracker remembers a direction by the state that it hears, and aims at it again.
TEST(BridgeOfAnAskewCamera, WhereTheStateSaysThatItLooksItLooksAgain) {
  BridgeBench bench({}, std::nullopt,
                    testing::kRigText + std::string("calibration: {camera: [10, -12, 15]}\n"));
  ASSERT_NO_FATAL_FAILURE(bench.home());
  const auto view = [&]() -> Eigen::Vector3d {
    return bench.devices().world_from_camera().rotation() * Eigen::Vector3d::UnitZ();
  };
  auto look = order_of(1, 2, RigMode::kSaccade);
  look.angles = {20 * kDegree, -5 * kDegree};
  bench.order(look);
  bench.pass(2s);
  const Eigen::Vector3d seen = view();
  const Eigen::Vector3d told = bench.state().imu.world_from_head * Eigen::Vector3d::UnitX();
  EXPECT_NEAR(told.z(), seen.z(), 0.01);  // both worlds have z up
  look.order.seq = 3;
  look.angles = {-20 * kDegree, 10 * kDegree};
  bench.order(look);
  bench.pass(2s);
  ASSERT_GT(std::acos(view().dot(seen)), 30 * kDegree);
  auto lock = order_of(1, 4, RigMode::kLock);
  lock.target = told;
  bench.order(lock);
  bench.pass(2s);
  EXPECT_LT(std::acos(std::min(1.0, view().dot(seen))), 1.5 * kDegree);
}

TEST_F(Bridge, WhatNoWearerDoesAndNoDeviceSuffersIsRefusedInWords) {
  for (const char* line : {"walk", "walk fast", "walk 100", "walk 1 500", "stand up", "turn", "turn 9000",
                           "turn 90 0", "walk nan", "fly", ""}) {
    const Status refused = bench_.devices().obey(line, bench_.now());
    ASSERT_FALSE(refused) << line;
    EXPECT_EQ(refused.error().code, ErrorCode::kUsage);
  }
  EXPECT_TRUE(bench_.devices().obey("drop+0.1", bench_.now()));
}

struct FaultCase {
  DeviceFault what;
  std::chrono::milliseconds within;
  const char* words;
};

class BridgeFault : public Bridge, public ::testing::WithParamInterface<FaultCase> {};

TEST_P(BridgeFault, LetsTheDrivesGoInTimeAndSaysWhy) {
  ASSERT_NO_FATAL_FAILURE(begin());
  auto away = order_of(1, 3, RigMode::kJog);
  away.rates = {-10 * kDegree, 6 * kDegree};
  bench_.order(away);
  bench_.pass(200ms);
  bench_.devices().inject(GetParam().what, std::nullopt, bench_.now());
  const auto time = bench_.until(is_idle, 2s);
  ASSERT_TRUE(time);
  EXPECT_LE(*time, GetParam().within);
  EXPECT_THAT(bench_.state().trouble, HasSubstr(GetParam().words));
  bench_.pass(1s);
  bench_.devices().tell_extremes();
  EXPECT_THAT(bench_.told.back(), HasSubstr("never at its hard stop"));
}

INSTANTIATE_TEST_SUITE_P(
    All, BridgeFault,
    ::testing::Values(FaultCase{DeviceFault::kResetPan, 1000ms, "pan (node 16)"},
                      FaultCase{DeviceFault::kResetTilt, 1000ms, "tilt (node 17)"},
                      FaultCase{DeviceFault::kStuckPan, 200ms, "pan (node 16) does not follow"},
                      FaultCase{DeviceFault::kStuckTilt, 200ms, "tilt (node 17) does not follow"},
                      FaultCase{DeviceFault::kMutePan, 100ms, "pan (node 16) does not answer"},
                      FaultCase{DeviceFault::kMuteTilt, 100ms, "tilt (node 17) does not answer"},
                      FaultCase{DeviceFault::kMuteImu, 100ms, "the IMU does not answer"},
                      FaultCase{DeviceFault::kImuRate, 1000ms, "the IMU samples at another rate"},
                      FaultCase{DeviceFault::kBusOff, 100ms, "does not answer"}));

TEST(ImuClock, ALateFrameMakesNoLateSampleAndTheCounterWraps) {
  ImuClock clock;
  EXPECT_FALSE(clock.offset());
  constexpr int64_t kTick = 100'000;
  const uint32_t begin = ~uint32_t{0} - 5'000;  // wraps after half a second
  const int64_t host_begin = 1'700'000'000'000'000'000;
  for (int i = 0; i < 300; ++i) {
    const int64_t taken = host_begin + int64_t{i} * 100 * kTick;
    const int64_t on_its_way = 300'000 + (i % 7) * 1'000'000;  // 0.3 ms and more
    clock.receive(begin + static_cast<uint32_t>(i) * 100, {taken + on_its_way});
    if (i >= 7) {
      EXPECT_NEAR(static_cast<double>(clock.newest().nanoseconds - taken), 300'000, 1) << i;
    }
  }
}

TEST(ScaledClock, StampsAndDeadlinesAreByOneSlowedClock) {
  for (const int factor : {1, 10}) {
    const ScaledClock clock(factor);
    const auto begin = clock.now();
    const Timestamp stamp = clock.wall_time();
    const auto when = clock.at(stamp);
    EXPECT_GE(when, begin - 2ms);
    EXPECT_LE(when, clock.now() + 2ms);
    EXPECT_EQ(clock.of_wall({5'000'000'000}).nanoseconds, 5'000'000'000 / factor);
  }
}

TEST(ImuClock, AnImuThatBeginsAnewIsBelievedAnew) {
  ImuClock clock;
  clock.receive(90'000, {5'000'000'000});
  clock.receive(90'100, {5'010'000'000});
  clock.receive(10, {7'000'000'000});
  EXPECT_EQ(clock.newest().nanoseconds, 7'000'000'000);
}

}  // namespace
}  // namespace cairn
