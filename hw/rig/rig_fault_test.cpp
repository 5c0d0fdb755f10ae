// SPDX-License-Identifier: Apache-2.0
// Faults of devices, bus and commander, by frames alone, in simulated time. RigBench checks at each
// millisecond that no axis is beyond its limits.
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <random>

#include "hw/can/test_seed.h"
#include "hw/rig/rig_bench.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using testing::kDegree;
using testing::RigBench;

/// Seeds of a test: phases of the cyclic messages and noise.
class RigFault : public ::testing::TestWithParam<uint32_t> {
 protected:
  /// Both axes turn at 60 deg/s.
  void start_turning() {
    ASSERT_NO_FATAL_FAILURE(bench_.start());
    bench_.point({0.0, 0}, {0.0, 0});
    bench_.pass(2s);
    bench_.point({std::nullopt, 60 * kDegree}, {std::nullopt, -60 * kDegree});
    bench_.pass(150ms + std::chrono::milliseconds(GetParam() * 7));
    ASSERT_TRUE(bench_.both<axis_state::Active>()) << bench_.rig().describe();
  }
  void expect_idle_within(std::chrono::milliseconds most) {
    const auto time = bench_.until([&] { return bench_.drives_are_idle(); }, 2s);
    ASSERT_TRUE(time) << bench_.rig().describe();
    EXPECT_LE(*time, most);
  }
  /// All that is needed to go on after a fault.
  void expect_recovery() {
    ASSERT_TRUE(bench_.command(rig_command::ClearFaults{}));
    ASSERT_TRUE(bench_.until(
        [&] { return bench_.is_at_rest(AxisName::kPan) && bench_.is_at_rest(AxisName::kTilt); }, 1s))
        << bench_.rig().describe();
    ASSERT_NO_FATAL_FAILURE(bench_.start());
  }

  RigBench bench_{GetParam()};
};
INSTANTIATE_TEST_SUITE_P(Seeds, RigFault, ::testing::Range(0U, 10U));

TEST_P(RigFault, WhenTheCommanderDiesTheDrivesAreIdled) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.commander_lives = false;
  expect_idle_within(100ms);
  EXPECT_EQ(bench_.rig().halt(), Halt::kCommanderSilent);
  EXPECT_THAT(bench_.rig().describe(), HasSubstr("the commander fell silent"));
  bench_.commander_lives = true;
  bench_.pass(300ms);
  EXPECT_TRUE(bench_.both<axis_state::Idle>());  // not by itself
  EXPECT_TRUE(bench_.command(rig_command::Activate{}));
  EXPECT_TRUE(bench_.until([&] { return bench_.both<axis_state::Active>(); }, 500ms));
}

TEST_P(RigFault, WhenTheImuDiesTheDrivesAreIdled) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().imu().mute(true);
  expect_idle_within(100ms);
  EXPECT_EQ(bench_.rig().halt(), Halt::kImuSilent);
  const Status refused = bench_.command(rig_command::Activate{});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("the IMU does not answer"));
}

TEST_P(RigFault, AnImuAtAnotherRateIsNamed) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().imu().set_frequency(200);
  bench_.pass(1200ms);
  EXPECT_EQ(bench_.rig().halt(), Halt::kImuRate);
  EXPECT_TRUE(bench_.drives_are_idle());
}

TEST_P(RigFault, WhenADriveDiesTheOtherIsIdledAndItselfByItsWatchdog) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().drive(0).mute(true);
  expect_idle_within(100ms);
  bench_.pass(20ms);
  EXPECT_EQ(bench_.fault(AxisName::kPan), AxisFault::kSilent);
  EXPECT_EQ(bench_.rig().halt(), Halt::kAxisFault);
  EXPECT_THAT(bench_.rig().describe(), HasSubstr("pan (node 16) does not answer"));
  bench_.bus().drive(0).mute(false);
  expect_recovery();
}

/// What one axis refuses is begun with neither: pan need not be homed again.
TEST_P(RigFault, AHomingThatOneAxisRefusesLeavesTheOtherHomed) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().drive(1).mute(true);
  ASSERT_TRUE(bench_.until([&] { return bench_.fault(AxisName::kTilt).has_value(); }, 2s));
  ASSERT_TRUE(bench_.until([&] { return bench_.is_at_rest(AxisName::kPan); }, 1s));
  ASSERT_TRUE(bench_.command(rig_command::ClearFaults{}));
  const auto stands_at = bench_.rig().axis(AxisName::kPan).position();
  ASSERT_TRUE(stands_at);
  const Status refused = bench_.command(rig_command::Home{});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("only an idle axis without a fault"));
  EXPECT_EQ(bench_.rig().axis(AxisName::kPan).position(), stands_at);
}

/// As with a bus that comes up after the rig's program.
TEST_P(RigFault, DrivesThatComeLateNeedNoOtherWordThanThoseThatWereThere) {
  bench_.bus().set_bus_off(true);
  bench_.pass(3s);
  EXPECT_EQ(bench_.fault(AxisName::kPan), AxisFault::kSilent);
  EXPECT_FALSE(bench_.command(rig_command::Home{}));
  bench_.bus().set_bus_off(false);
  bench_.pass(300ms);
  EXPECT_EQ(bench_.rig().describe(), "");
  EXPECT_TRUE(bench_.drives_are_idle());
  ASSERT_NO_FATAL_FAILURE(bench_.start());
  // Once it was there, its silence is a fault until somebody says otherwise.
  bench_.bus().set_bus_off(true);
  bench_.pass(3s);
  bench_.bus().set_bus_off(false);
  bench_.pass(1s);
  EXPECT_TRUE(bench_.fault(AxisName::kPan));
}

TEST_P(RigFault, AStuckAxisIsReported) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().drive(1).block(true);
  const auto time = bench_.until([&] { return bench_.fault(AxisName::kTilt).has_value(); }, 2s);
  ASSERT_TRUE(time);
  EXPECT_LE(*time, 200ms);
  EXPECT_EQ(bench_.fault(AxisName::kTilt), AxisFault::kStuck);
  expect_idle_within(10ms);
  bench_.bus().drive(1).block(false);
  expect_recovery();
}

TEST_P(RigFault, AnAxisThatIsStuckFromTheStartIsReported) {
  ASSERT_NO_FATAL_FAILURE(bench_.start());
  bench_.point({0.0, 0}, {0.0, 0});
  bench_.pass(2s);
  bench_.bus().drive(0).block(true);
  bench_.pass(300ms);
  EXPECT_FALSE(bench_.fault(AxisName::kPan));  // nothing was to move
  bench_.point({30 * kDegree, 0}, {0.0, 0});
  const auto time = bench_.until([&] { return bench_.fault(AxisName::kPan).has_value(); }, 2s);
  ASSERT_TRUE(time);
  EXPECT_LE(*time, 200ms);
  EXPECT_EQ(bench_.fault(AxisName::kPan), AxisFault::kStuck);
}

TEST_P(RigFault, AResetDriveIsNamedAndTheRigIsSafelyStopped) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().drive(0).reset();
  expect_idle_within(100ms);
  bench_.pass(1s);
  const auto fault = bench_.fault(AxisName::kPan);
  EXPECT_TRUE(fault == AxisFault::kSilent || fault == AxisFault::kReset);
  EXPECT_FALSE(bench_.rig().axis(AxisName::kPan).position());  // its zero is another one now
  ASSERT_TRUE(bench_.command(rig_command::ClearFaults{}));
  bench_.pass(500ms);
  EXPECT_FALSE(bench_.command(rig_command::Activate{}));  // home it first
  expect_recovery();
}

TEST_P(RigFault, ABusThatIsOffStopsAllAndComesBack) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.bus().set_bus_off(true);
  expect_idle_within(100ms);  // by the drives' own watchdogs
  bench_.pass(500ms);
  EXPECT_EQ(bench_.fault(AxisName::kPan), AxisFault::kSilent);
  EXPECT_EQ(bench_.fault(AxisName::kTilt), AxisFault::kSilent);
  bench_.bus().set_bus_off(false);
  bench_.pass(500ms);
  EXPECT_TRUE(bench_.drives_are_idle());
  expect_recovery();
}

TEST_P(RigFault, ATenthOfTheFramesLostIsNone) {
  ASSERT_NO_FATAL_FAILURE(bench_.start());
  bench_.bus().drop(0.1);
  for (int i = 0; i < 5; ++i) {
    bench_.point({(i % 2 == 0 ? 40 : -40) * kDegree, 0}, {(i % 2 == 0 ? -30 : 30) * kDegree, 0});
    bench_.pass(1s);
  }
  EXPECT_TRUE(bench_.both<axis_state::Active>()) << bench_.rig().describe();
}

TEST_P(RigFault, AfterAPauseOfTheHostTheDrivesWatchdogIsNamed) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.pause(80ms);
  EXPECT_TRUE(bench_.drives_are_idle());
  bench_.pass(300ms);
  EXPECT_TRUE(bench_.fault(AxisName::kPan) == AxisFault::kWatchdog ||
              bench_.fault(AxisName::kTilt) == AxisFault::kWatchdog)
      << bench_.rig().describe();
  expect_recovery();
}

TEST_P(RigFault, ATimeThatRunsBackIdlesTheDrives) {
  ASSERT_NO_FATAL_FAILURE(start_turning());
  bench_.rig().advance(bench_.now() - 1s);
  EXPECT_EQ(bench_.rig().halt(), Halt::kClockRanBack);
  EXPECT_TRUE(bench_.both<axis_state::Idle>());
}

/// What was found by RigMishaps: an axis that was held for a moment hurries after its setpoints, and an
/// emergency stop then lets go of it near its limit.
TEST_P(RigFault, AnAxisThatHurriesAfterItsSetpointsMayBeLetGoToo) {
  std::mt19937 random(GetParam());
  ASSERT_NO_FATAL_FAILURE(bench_.start());
  for (int i = 0; i < 20; ++i) {
    bench_.point({-50 * kDegree, 0}, {-34 * kDegree, 0});
    bench_.pass(2s);
    bench_.point({std::nullopt, 10}, {std::nullopt, 10});
    bench_.pass(std::chrono::milliseconds(400 + random() % 500));
    for (const size_t drive : {size_t{0}, size_t{1}}) bench_.bus().drive(drive).block(true);
    bench_.pass(std::chrono::milliseconds(30 + random() % 60));
    for (const size_t drive : {size_t{0}, size_t{1}}) bench_.bus().drive(drive).block(false);
    bench_.pass(std::chrono::milliseconds(20 + random() % 150));
    ASSERT_TRUE(bench_.command(rig_command::Stop{}));
    ASSERT_NO_FATAL_FAILURE(bench_.pass(500ms));
    ASSERT_TRUE(bench_.command(rig_command::ClearStop{"shoulder"}));
    bench_.pass(200ms);
    ASSERT_TRUE(bench_.command(rig_command::Activate{})) << bench_.rig().describe();
    bench_.pass(200ms);
  }
}

/// What a walking shoulder made of it: setpoints that turn back, and an axis that does so three periods
/// later.
TEST(StallWatch, AnAxisThatTurnsBackAfterItsSetpointsIsNotStuck) {
  for (double amplitude = 0.5; amplitude < 10; amplitude *= 1.2) {
    for (double frequency = 0.5; frequency < 5 && amplitude * frequency < 15; frequency *= 1.1) {
      StallWatch lags(0.01, StallOptions());
      StallWatch held(0.01, StallOptions());
      const auto at = [&](double t) {
        return amplitude * kDegree * std::sin(2 * std::numbers::pi * frequency * t);
      };
      bool stuck = false;
      for (int i = 0; i < 500; ++i) {
        ASSERT_FALSE(lags.is_stuck(at(0.01 * i), at(0.01 * i - 0.03))) << amplitude << " " << frequency;
        stuck = held.is_stuck(at(0.01 * i), 0) || stuck;
      }
      EXPECT_TRUE(stuck || amplitude * frequency < 2) << amplitude << " " << frequency;
    }
  }
}

/// Whatever happens, in whatever order.
class Mishaps {
 public:
  explicit Mishaps(uint32_t seed)
      : random_(seed), bench_(seed, 50 * kDegree * unit(), 35 * kDegree * unit()) {
    bench_.walk({1});
  }

  /// Milliseconds in which both axes were active.
  int run(std::chrono::milliseconds time) {
    int active = 0;
    for (; time.count() > 0 && !::testing::Test::HasFatalFailure(); --time) {
      if (random_() % 100 == 0) happen(random_() % 24);
      if (random_() % 30 == 0) go_on();
      bench_.millisecond();
      if (bench_.both<axis_state::Active>()) ++active;
    }
    return active;
  }

 private:
  double unit() { return std::uniform_real_distribution<double>(-1, 1)(random_); }

  Demand demand() {
    if (random_() % 2 == 0) return {std::nullopt, 10 * unit()};
    return {3 * unit(), random_() % 2 == 0 ? 0 : 4 * unit()};
  }
  Pointing aim() {
    const Eigen::Vector3d direction(unit(), unit(), unit());
    const std::array<Pointing, 6> all = {pointing::Neutral{{2 * unit(), 2 * unit()}},
                                         pointing::Jog{{5 * unit(), 5 * unit()}},
                                         pointing::Follow{},
                                         pointing::Lock{direction},
                                         pointing::Saccade{direction, {}},
                                         pointing::Search{}};
    return all.at(random_() % all.size());
  }
  /// What an operator does who wants it to run.
  void go_on() {
    bench_.commander_lives = true;
    if (bench_.rig().is_stopped()) ask(rig_command::ClearStop{"shoulder"});
    if (bench_.both<axis_state::Unknown>()) ask(rig_command::Home{});
    if (bench_.both<axis_state::Idle>()) ask(rig_command::Activate{});
    for (const AxisName name : kAxisNames) {
      if (bench_.fault(name)) ask(rig_command::ClearFaults{});
      if (std::holds_alternative<axis_state::Unknown>(bench_.rig().axis(name).state()))
        ask(rig_command::Home{});
    }
  }
  /// May be refused.
  void ask(decltype(RigCommand::what) what) {
    const Status done = bench_.command(std::move(what));
    EXPECT_TRUE(done || done.error().code == ErrorCode::kRefused);
  }
  void happen(uint32_t what) {
    auto& bus = bench_.bus();
    const size_t drive = random_() % 2;
    if (what == 0) bus.drive(drive).reset();
    if (what == 1) bus.drive(drive).block(true);
    if (what == 2) bus.drive(drive).mute(true);
    if (what == 3) bus.set_bus_off(true);
    if (what == 4) bus.imu().mute(true);
    if (what == 5) bus.drop(0.4 * (unit() + 1));
    if (what == 6) bench_.commander_lives = false;
    if (what == 7) ask(rig_command::Stop{});
    if (what == 8) ask(rig_command::Idle{});
    if (what >= 9 && what <= 14) mend();
    if (what > 14 && what <= 19) ask(rig_command::Point{{demand(), demand()}});
    if (what > 19) ask(rig_command::Aim{aim()});
  }
  void mend() {
    auto& bus = bench_.bus();
    for (const size_t drive : {size_t{0}, size_t{1}}) {
      bus.drive(drive).block(false);
      bus.drive(drive).mute(false);
    }
    bus.set_bus_off(false);
    bus.imu().mute(false);
    bus.drop(0);
  }

  std::mt19937 random_;
  RigBench bench_;
};

TEST(RigMishaps, WhateverHappensNoAxisLeavesItsLimits) {
  const uint32_t first = testing::any_seed();
  int active = 0;
  for (uint32_t seed = first; seed != first + 8; ++seed) {
    SCOPED_TRACE(seed);
    active += Mishaps(seed).run(60s);
    if (HasFailure()) return;
  }
  EXPECT_GT(active, 8 * 60'000 / 50);  // or nothing was tested
  RecordProperty("active_ms", active);
}

}  // namespace
}  // namespace cairn
