// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/rig.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <vector>

#include "hw/rig/rig_bench.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using testing::kDegree;
using testing::RigBench;

constexpr uint32_t kSeed = 1;

TEST(Rig, FindsItsPositionAndPointsWhereItIsTold) {
  RigBench bench(kSeed, 0.3, -0.2);
  ASSERT_NO_FATAL_FAILURE(bench.start());
  bench.point({20 * kDegree, 0}, {-10 * kDegree, 0});
  bench.pass(3s);
  // Within the backlash, and what friction leaves.
  EXPECT_NEAR(bench.angle(AxisName::kPan), 20 * kDegree, 0.5 * kDegree);
  EXPECT_NEAR(bench.angle(AxisName::kTilt), -10 * kDegree, 0.5 * kDegree);
  EXPECT_NEAR(bench.rig().axis(AxisName::kPan).position().value(), 20 * kDegree, 0.4 * kDegree);
  EXPECT_EQ(bench.rig().describe(), "");
}

TEST(Rig, DemandsBeyondTheLimitsEndAtTheSoftOnes) {
  RigBench bench(kSeed);
  ASSERT_NO_FATAL_FAILURE(bench.start());
  bench.point({std::nullopt, 100}, {1e9, -5});
  bench.pass(3s);
  EXPECT_NEAR(bench.angle(AxisName::kPan), 53 * kDegree, 0.5 * kDegree);
  EXPECT_NEAR(bench.angle(AxisName::kTilt), 35 * kDegree, 0.5 * kDegree);
  EXPECT_FALSE(
      bench.rig().take({"tracker", rig_command::Point{{Demand{std::nan(""), 0}, Demand()}}}, bench.now()));
}

TEST(Rig, MovesOnlyWhereItIsKnownToStand) {
  RigBench bench(kSeed);
  bench.pass(200ms);
  const Status active = bench.command(rig_command::Activate{});
  ASSERT_FALSE(active);
  EXPECT_EQ(active.error().code, ErrorCode::kRefused);
  EXPECT_THAT(active.error().message, HasSubstr("home it first"));
  bench.pass(200ms);
  EXPECT_TRUE(bench.drives_are_idle());
}

TEST(Rig, WhatIsRefusedLeavesActiveAxesActive) {
  RigBench bench(kSeed);
  ASSERT_NO_FATAL_FAILURE(bench.start());
  EXPECT_FALSE(bench.command(rig_command::Home{}));
  EXPECT_FALSE(bench.command(rig_command::Activate{}));
  bench.pass(100ms);
  EXPECT_TRUE(bench.both<axis_state::Active>());
}

TEST(Rig, ASecondCommanderIsRefusedButMayStop) {
  RigBench bench(kSeed);
  ASSERT_NO_FATAL_FAILURE(bench.start());
  const Status other = bench.rig().take({"other", rig_command::Idle{}}, bench.now());
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("commanded by tracker"));
  EXPECT_TRUE(bench.both<axis_state::Active>());
  EXPECT_TRUE(bench.rig().take({"other", rig_command::Stop{}}, bench.now()));
  EXPECT_TRUE(bench.both<axis_state::Stopped>());
  bench.commander_lives = false;
  bench.pass(100ms);
  EXPECT_TRUE(bench.rig().take({"other", rig_command::Stay{}}, bench.now()));
}

TEST(Rig, AnEmergencyStopIsAtOnceAndStaysUntilClearedByName) {
  for (const double dropped : {0.0, 0.4}) {
    RigBench bench(kSeed);
    ASSERT_NO_FATAL_FAILURE(bench.start());
    bench.point({std::nullopt, 2}, {std::nullopt, 2});
    bench.pass(100ms);
    bench.bus().drop(dropped);
    ASSERT_TRUE(bench.command(rig_command::Stop{}));
    const auto time = bench.until([&] { return bench.drives_are_idle(); }, 1s);
    ASSERT_TRUE(time);
    EXPECT_LE(*time, dropped == 0 ? 3ms : 50ms);
    bench.bus().drop(0);
    bench.pass(300ms);
    EXPECT_FALSE(bench.command(rig_command::Activate{}));
    EXPECT_FALSE(bench.command(rig_command::Home{}));
    EXPECT_TRUE(bench.command(rig_command::ClearFaults{}));
    const Status wrong = bench.command(rig_command::ClearStop{"hip"});
    ASSERT_FALSE(wrong);
    EXPECT_THAT(wrong.error().message, HasSubstr("this rig is shoulder"));
    bench.pass(300ms);
    EXPECT_TRUE(bench.both<axis_state::Stopped>());
    EXPECT_TRUE(bench.command(rig_command::ClearStop{"shoulder"}));
    ASSERT_TRUE(bench.until([&] { return bench.both<axis_state::Idle>(); }, 500ms)) << bench.rig().describe();
    EXPECT_TRUE(bench.command(rig_command::Activate{}));
    EXPECT_TRUE(bench.until([&] { return bench.both<axis_state::Active>(); }, 500ms))
        << bench.rig().describe();
  }
}

TEST(Rig, StrangeFramesDisturbNothing) {
  RigBench bench(kSeed);
  ASSERT_NO_FATAL_FAILURE(bench.start());
  const auto before = bench.rig().counters().strange_frames;
  EXPECT_EQ(bench.rig().describe_strange(), "");
  const std::pair<CanFrame, const char*> frames[] = {
      {{.id = {0x281, false}, .length = 8}, "281: of a node that the rig does not have"},
      {{.id = {0x201, false}, .length = 7}, "201: 7 bytes, not the 8"},
      {{.id = {0x032, false}, .length = 4}, "032: 4 bytes, not the 6 of this message of the IMU"},
      {{.id = {0x209, false}, .length = 8, .data = {0, 0, 0xC0, 0x7F}}, "209: a number that is not finite"},
      {{.id = {0x201, true}}, "201: extended"}};
  for (const auto& [frame, words] : frames) {
    bench.rig().receive(frame, bench.now());
    EXPECT_THAT(bench.rig().describe_strange(), ::testing::HasSubstr(words));
  }
  EXPECT_EQ(bench.rig().counters().strange_frames, before + 5);
  bench.pass(100ms);
  EXPECT_TRUE(bench.both<axis_state::Active>());
}

TEST(Rig, WhatCannotBeAimedAtIsRefused) {
  RigBench bench(kSeed);
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Lock{Eigen::Vector3d(0, 0, 0)}}));
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Lock{Eigen::Vector3d(std::nan(""), 0, 0)}}));
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Jog{{std::nan(""), 0}}}));
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Saccade{Eigen::Vector3d(0, 0, 0), {}}}));
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Search{.view = {0, 1}, .ranked = {}}}));
  EXPECT_FALSE(bench.command(rig_command::Aim{pointing::Search{.ranked = {Eigen::Vector3d::Zero()}}}));
  bench.pass(50ms);
  EXPECT_FALSE(bench.command(rig_command::Sight{{bench.now() - 2s, {0, 0, 1}}}));
  EXPECT_FALSE(bench.command(rig_command::Sight{{bench.now() + 2s, {0, 0, 1}}}));
  EXPECT_FALSE(bench.command(rig_command::Sight{{bench.now(), {0, 0, 0}}}));
  std::string text = testing::kRigText;
  text.erase(text.find("imu: {rate: 100}"), 17);
  RigBench blind(kSeed, 0, 0, text);
  const Status refused = blind.command(rig_command::Aim{pointing::Lock{}});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("has no IMU"));
}

TEST(Rig, SetpointsGoOutRightBehindTheSampleThatTheyAreMadeFrom) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    RigBench bench(seed);
    ASSERT_NO_FATAL_FAILURE(bench.start());
    ASSERT_TRUE(bench.command(rig_command::Aim{pointing::Lock{}}));
    bench.pass(1s);
    std::vector<double> waits;  // [ms]
    Eigen::Vector3d rate = bench.rig().attitude().rate();
    MonotonicTime sampled = bench.now();
    MonotonicTime due = bench.rig().next_due();
    for (int i = 0; i < 20'000; ++i) {
      bench.step(50us);
      if (bench.rig().attitude().rate() != rate) sampled = bench.now();
      rate = bench.rig().attitude().rate();
      if (bench.rig().next_due() > due + 5ms)
        waits.push_back(std::chrono::duration<double, std::milli>(bench.now() - sampled).count());
      due = bench.rig().next_due();
    }
    ASSERT_NEAR(static_cast<double>(waits.size()), 100, 2);
    std::nth_element(waits.begin(), waits.begin() + 50, waits.end());
    EXPECT_LT(waits[50], 0.5);
  }
}

TEST(ImuWatch, ItsRateIsToldByItsOwnClockWhateverIsLost) {
  for (const double frequency : {100.0, 200.0}) {
    simulated::ImuOptions options;
    options.frequency = frequency;
    const MonotonicTime start{1h};
    simulated::SimulatedImu imu(options, kSeed, start);
    std::vector<CanFrame> frames;
    imu.advance(start + 2s, frames);
    ImuWatch watch(100, RigTimingOptions().imu_rate_off, 50ms, start);
    for (size_t i = 0; i < frames.size(); ++i) {
      if (i / 4 % 3 != 0)
        watch.receive(xsens::decode(frames[i]).value(), start);  // a third of the samples lost
    }
    ASSERT_TRUE(watch.measured_rate());
    EXPECT_NEAR(*watch.measured_rate(), frequency, 1);
    EXPECT_EQ(watch.is_at_wrong_rate(), frequency != 100);
  }
}

}  // namespace
}  // namespace cairn
