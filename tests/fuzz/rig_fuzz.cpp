// SPDX-License-Identifier: Apache-2.0
//
// The configuration of a rig, which a person writes and a calibration adds to.
#include <cmath>
#include <string>

#include "hw/rig/calibration_file.h"
#include "hw/rig/rig.h"
#include "hw/rig/rig_configuration.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

RigCalibration calibration() {
  RigCalibration found;
  found.head_from_imu = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitX());
  found.offset = std::chrono::milliseconds(12);
  found.knows_mounts = found.knows_offset = true;
  return found;
}

constexpr const char* kTilt =
    "  tilt: {node: 17, gear: -20, home: 36, position: [-40, 40], margin: 5, rate: 120, acceleration: 500, "
    "coasting: 250, gain: 20, current: 5, neutral: 0, lag: 7, backlash: 0.3}\n";
constexpr const char* kPan =
    "axes:\n  pan:\n    node: 16\n    gear: 20\n    home: -56 # [deg]\n    position: [-58, 58]\n    margin: "
    "5\n"
    "    rate: 120\n    acceleration: 500\n    coasting: 250\n    gain: 20\n    current: 5\n    neutral: 0\n";

}  // namespace

void decode(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto rig = read_rig_configuration(file.path());
  if (!rig) return demand(!rig.error().message.empty(), "a refusal has a reason");
  MonotonicTime now{std::chrono::hours(1)};
  Rig runs(*rig, now);
  static_cast<void>(runs.take({"ann", rig_command::Home{}}, now));
  for (int i = 0; i < 20; ++i) runs.advance(now += rig->period);
  for (const AxisConfiguration& axis : rig->axes)
    demand(axis.turns_per_radian != 0 && axis.limits.low < axis.limits.high,
           "an axis turns within its limits");
  // Whether a calibration could be put in, write_calibration() tells by reading it again.
  static_cast<void>(with_calibration(std::string(text_of(bytes)), calibration(), rig->imu.has_value()));
}

std::vector<Input> seeds() {
  const std::string head =
      "name: shoulder\nperiod: 10 # [ms]\ndeadlines: {commander: 60, imu: 50, drive: 50}\n";
  const std::string plain = head + kPan + kTilt;
  const std::string with_imu = head + "imu: {rate: 100}\n" + kPan + kTilt;
  std::vector<Input> all{copy_of(plain), copy_of(with_imu),
                         copy_of(with_calibration(with_imu, calibration(), true))};
  for (const Input& text : all) {
    const MemoryFile file(text);
    const auto rig = read_rig_configuration(file.path());
    demand(rig.has_value(), rig ? std::string() : rig.error().message);
  }
  return all;
}

}  // namespace cairn::fuzz
