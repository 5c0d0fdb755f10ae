// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/rig_configuration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <string>

#include "hw/rig/test_rig.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using testing::read_rig;

/// The sound configuration with `from` in place of `to`.
std::string changed(const std::string& from, const std::string& to) {
  std::string text = testing::kRigText;
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(RigConfiguration, IsReadAsWritten) {
  const auto rig = read_rig(testing::kRigText);
  ASSERT_TRUE(rig) << rig.error().message;
  constexpr double kRadians = std::numbers::pi / 180;
  const AxisConfiguration& tilt = rig->axis(AxisName::kTilt);
  EXPECT_EQ(rig->name, "shoulder");
  EXPECT_EQ(tilt.node, odrive::Node{17});
  EXPECT_NEAR(tilt.limits.low, -40 * kRadians, 1e-12);
  EXPECT_NEAR(tilt.limits.acceleration, 500 * kRadians, 1e-12);
  EXPECT_NEAR(tilt.turns_per_radian, -20 / (2 * std::numbers::pi), 1e-12);
  EXPECT_NEAR(tilt.limits.reaction, 0.05, 1e-12);
  EXPECT_NEAR(tilt.limits.lag, 0.007, 1e-12);
  EXPECT_NEAR(tilt.backlash, 0.3 * kRadians, 1e-12);
  EXPECT_EQ(rig->drive_deadline, std::chrono::milliseconds(50));
  ASSERT_TRUE(rig->imu);
  EXPECT_EQ(rig->imu->rate, 100);
}

/// The example that people start from has all keys: those of pan are those of the tests.
TEST(RigConfiguration, TheExampleIsRead) {
  const auto rig = read_rig_configuration(CAIRN_EXAMPLE_RIG);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_NEAR(rig->axis(AxisName::kPan).limits.lag, 0.007, 1e-12);
  const auto walking = read_rig(testing::walking_rig());
  ASSERT_TRUE(walking);
  for (const AxisName name : kAxisNames) {
    EXPECT_EQ(rig->axis(name).limits.acceleration, walking->axis(name).limits.acceleration);
    EXPECT_EQ(rig->axis(name).turns_per_radian, walking->axis(name).turns_per_radian);
    EXPECT_EQ(rig->axis(name).backlash, walking->axis(name).backlash);
  }
}

TEST(RigConfiguration, ACalibrationIsRead) {
  const auto rig =
      read_rig(changed("axes:", "calibration: {camera: [0, 0, 10], imu: [90, 0, 0], offset: -2.5}\naxes:"));
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_GT((rig->calibration.head_from_camera * Eigen::Vector3d::UnitZ()).y(), 0.1);  // it looks to the left
  EXPECT_NEAR((rig->calibration.head_from_imu * Eigen::Vector3d::UnitY()).z(), 1, 1e-12);
  EXPECT_EQ(rig->calibration.offset, std::chrono::microseconds(-2500));
}

TEST(RigConfiguration, ARigMayHaveNoImu) {
  const auto rig = read_rig(changed("imu: {rate: 100}\n", ""));
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_FALSE(rig->imu);
}

TEST(RigConfiguration, WhatIsWrittenIsReadAsTheSame) {
  const std::string straight = "calibration: {camera: [0, 0, 0], imu: [0, 0, 0]}\naxes:";
  const std::string turned = "calibration: {imu: [90, 0.125, -3], offset: -2.5}\naxes:";
  for (const std::string& text :
       {std::string(testing::kRigText), testing::walking_rig(), changed("axes:", straight),
        changed("axes:", turned), changed("imu: {rate: 100}\n", ""), changed("gear: 20", "gear: -13.37")}) {
    const auto rig = read_rig(text);
    ASSERT_TRUE(rig) << rig.error().message;
    const std::string written = write_rig_configuration(*rig);
    const auto again = read_rig(written);
    ASSERT_TRUE(again) << again.error().message << "\n" << written;
    EXPECT_EQ(write_rig_configuration(*again), written);
    EXPECT_EQ(again->calibration.knows_mounts, rig->calibration.knows_mounts);
    EXPECT_EQ(again->imu.has_value(), rig->imu.has_value());
    for (const AxisName name : kAxisNames) {
      EXPECT_NEAR(again->axis(name).turns_per_radian, rig->axis(name).turns_per_radian, 1e-9);
      EXPECT_NEAR(again->axis(name).limits.low, rig->axis(name).limits.low, 1e-9);
      EXPECT_NEAR(again->axis(name).limits.reaction, rig->axis(name).limits.reaction, 1e-9);
      EXPECT_NEAR(again->axis(name).limits.lag, rig->axis(name).limits.lag, 1e-9);
    }
  }
}

TEST(RigTuning, DefaultsAreInTheirRangesAndEachMemberIsListedOnce) {
  RigTuning tuning;
  const Status checked = check_options(tuning);
  EXPECT_TRUE(checked) << checked.error().message;
  const Status complete = list_options(&tuning).check_complete();
  EXPECT_TRUE(complete) << complete.error().message;
}

TEST(RigConfiguration, TheConstantsOfTheMethodsAreReadAndWritten) {
  const std::string tuned = changed("axes:", "tuning:\n  pointer: {glance: 0.3, gap: 80}\naxes:");
  const auto rig = read_rig(tuned);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->tuning.pointer.glance, 0.3);
  EXPECT_EQ(rig->tuning.pointer.gap, std::chrono::milliseconds(80));
  EXPECT_EQ(rig->tuning.pointer.patience, PointerOptions().patience);
  const auto again = read_rig(write_rig_configuration(*rig));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->tuning.pointer.glance, 0.3);
  const auto misspelt = read_rig(changed("axes:", "tuning:\n  pointer: {glanse: 0.3}\naxes:"));
  ASSERT_FALSE(misspelt);
  EXPECT_THAT(misspelt.error().message, HasSubstr("unknown key 'glanse'; did you mean glance?"));
  const auto unsafe = read_rig(changed("axes:", "tuning: {axis: {runaway_rate: 100}}\naxes:"));
  ASSERT_FALSE(unsafe);
  EXPECT_THAT(unsafe.error().message, HasSubstr("runaway_rate is 100: expected 1 to 3"));
}

struct Impossible {
  const char* from;
  const char* to;
  const char* message;
};

class RigConfigurationImpossible : public ::testing::TestWithParam<Impossible> {};

TEST_P(RigConfigurationImpossible, IsNamedWithLineAndRemedy) {
  const auto rig = read_rig(changed(GetParam().from, GetParam().to));
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(rig.error().message, HasSubstr(GetParam().message));
}

INSTANTIATE_TEST_SUITE_P(
    All, RigConfigurationImpossible,
    ::testing::Values(
        Impossible{"name: shoulder", "name: Left Shoulder",
                   ".yaml:1: name: expected 1 to 32 of a-z, 0-9 and -"},
        Impossible{"gain: 20", "gainn: 20", ".yaml:15: axes.pan: unknown key 'gainn'; did you mean gain?"},
        Impossible{"    gain: 20\n", "", ".yaml:7: axes.pan: gain is missing; add `gain: ...`"},
        Impossible{"gain: 20", "gain: 20\n    gain: 21",
                   ".yaml:16: axes.pan: 'gain' is there twice; keep one"},
        Impossible{"gain: 20", "gain: -20", ".yaml:15: axes.pan: gain -20: expected a number above 0"},
        Impossible{"lag: 7", "lag: -7", "axes.pan: lag -7: expected 0 to 50"},
        Impossible{"backlash: 0.3", "backlash: 6", "axes.pan: backlash 6: expected 0 to 5"},
        Impossible{"gain: 20", "gain: 1e999", "gain '1e999': expected a number"},
        Impossible{"gain: 20", "gain: nan", "gain 'nan': expected a number"},
        Impossible{"gain: 20", "gain: [20]", "gain '': expected a number"},
        Impossible{"node: 17", "node: 16",
                   "axes: tilt: node 16 is that of pan too; each drive needs its own"},
        Impossible{"node: 17", "node: 3", "axes.tilt: node 3: expected 4 to 63"},
        Impossible{"node: 17", "node: 17.5", "node: expected a whole number"},
        Impossible{"gear: 20", "gear: 0", "axes.pan: gear: 0 turns nothing"},
        Impossible{"[-58, 58]", "[58, -58]", ".yaml:10: axes.pan: position: the limits are crossed"},
        Impossible{"[-58, 58]", "58", "position: expected two numbers, `position: [-60, 60]`"},
        Impossible{"margin: 5", "margin: 60", "margin: nothing is left between the soft limits"},
        Impossible{"home: -56", "home: -66", "home: the homing switch is outside of `position`"},
        Impossible{"neutral: 0", "neutral: 57", "neutral: outside of the soft limits"},
        Impossible{"rate: 120", "rate: 0", "rate 0: expected a number above 0"},
        Impossible{"rate: 120", "rate: 1200",
                   "rate: with this gear the motor would have to make more than 32.767"},
        Impossible{"current: 5", "current: much", "current 'much': expected a number"},
        Impossible{"commander: 60", "commander: 500", "deadlines: commander 500: expected 40 to 80"},
        Impossible{"period: 10", "period: 0", "period 0: expected 2 to 20"},
        Impossible{"rate: 100}", "rate: 1000}", "imu: rate 1000: expected 50 to 400"},
        Impossible{"axes:", "calibration: {camera: [0, 0, 90]}\naxes:",
                   "calibration: camera: it would look along the tilt axis"},
        Impossible{"axes:", "calibration: {imu: 5}\naxes:", "imu: expected three numbers"},
        Impossible{"axes:", "calibration: {offset: 9999}\naxes:", "offset 9999: expected -1000 to 1000"},
        Impossible{"name: shoulder\n", "", "name is missing; add `name: ...`"}));

TEST(RigConfiguration, WhatIsNoMappingIsRefused) {
  EXPECT_FALSE(read_rig(""));
  EXPECT_FALSE(read_rig("- 1\n- 2\n"));
  EXPECT_FALSE(read_rig("axes: 5\nname: a\n"));
  EXPECT_FALSE(read_rig("{"));
  EXPECT_THAT(read_rig_configuration("/no/such/file").error().message, HasSubstr("cannot be read"));
}

}  // namespace
}  // namespace cairn
