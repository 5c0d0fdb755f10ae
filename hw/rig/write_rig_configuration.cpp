// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "common/base/option_yaml.h"
#include "common/geometry/se3.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

/// Nine decimals: what a conversion of units loses does not show, and the same number is read again.
std::string number(double value) {
  return fmt::format("{:.12g}", std::round(value * 1e9) / 1e9 + 0.0);
}

std::string degrees(double radians) {
  return number(radians / kRadians);
}

std::string turn(const Eigen::Quaterniond& rotation) {
  const Eigen::Vector3d vector = so3_log(rotation);
  return fmt::format("[{}, {}, {}]", degrees(vector.x()), degrees(vector.y()), degrees(vector.z()));
}

/// An optional key that is not there stays away where that means something: who does not know how camera and
/// IMU sit takes them to sit straight, and says so.
std::string write_calibration(const RigCalibration& calibration) {
  const std::string straight = turn(Eigen::Quaterniond::Identity());
  const std::string camera = turn(calibration.head_from_camera * nominal_head_from_camera().conjugate());
  const std::string imu = turn(calibration.head_from_imu);
  std::string keys;
  if (calibration.knows_mounts || camera != straight) keys += fmt::format("  camera: {}  # [deg]\n", camera);
  if (calibration.knows_mounts || imu != straight) keys += fmt::format("  imu: {}  # [deg]\n", imu);
  if (calibration.knows_offset)
    keys +=
        fmt::format("  offset: {}  # [ms]\n", number(static_cast<double>(calibration.offset.count()) / 1e6));
  return keys.empty() ? "" : "calibration:\n" + keys;
}

std::string write_axis(AxisName name, const AxisConfiguration& axis) {
  const MotionLimits& limits = axis.limits;
  std::string text = fmt::format("  {}:\n", to_string(name));
  const auto add = [&text](const char* key, const std::string& value, const char* unit) {
    text += fmt::format("    {}: {}  # {}\n", key, value, unit);
  };
  add("node", fmt::format("{}", axis.node.value), "of the drive");
  add("gear", number(axis.turns_per_radian * 2 * std::numbers::pi), "turns of the motor for one of the axis");
  add("home", degrees(axis.home), "[deg]");
  add("neutral", degrees(axis.neutral), "[deg]");
  add("position", fmt::format("[{}, {}]", degrees(limits.low), degrees(limits.high)), "[deg]");
  add("margin", degrees(limits.margin), "[deg]");
  add("rate", degrees(limits.rate), "[deg/s]");
  add("acceleration", degrees(limits.acceleration), "[deg/s^2]");
  add("coasting", degrees(limits.coasting), "[deg/s^2]");
  add("gain", number(1 / limits.reaction), "[1/s]");
  add("current", number(axis.current), "[A]");
  add("lag", number(limits.lag * 1000), "[ms]");
  add("backlash", degrees(axis.backlash), "[deg]");
  return text;
}

}  // namespace

std::string write_rig_configuration(const RigConfiguration& rig) {
  std::string text =
      fmt::format("# cairn-rig --config\nname: {}\nperiod: {}  # [ms]\n", rig.name, rig.period.count());
  text += fmt::format("deadlines:  # [ms]\n  commander: {}\n  imu: {}\n  drive: {}\n",
                      rig.commander_deadline.count(), rig.imu_deadline.count(), rig.drive_deadline.count());
  if (rig.imu) text += fmt::format("imu:\n  rate: {}  # [Hz]\n", number(rig.imu->rate));
  text += write_calibration(rig.calibration) + "axes:\n";
  for (const AxisName name : kAxisNames) text += write_axis(name, rig.axis(name));
  RigTuning tuning = rig.tuning;
  return text + "tuning:\n" + write_options(list_options(&tuning), 2);
}

}  // namespace cairn
