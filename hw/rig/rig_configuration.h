// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "hw/can/odrive.h"
#include "hw/rig/kinematics.h"
#include "hw/rig/motion_profile.h"
#include "hw/rig/rig_tuning.h"

namespace cairn {

enum class AxisName : uint8_t { kPan, kTilt };
constexpr std::array<AxisName, 2> kAxisNames = {AxisName::kPan, AxisName::kTilt};
[[nodiscard]] const char* to_string(AxisName name);

struct AxisConfiguration {
  odrive::Node node;
  double turns_per_radian = 1;  ///< of the motor's shaft; negative where it turns the other way; never 0
  double home = 0;              ///< angle of the axis at its homing switch [rad]
  double neutral = 0;           ///< [rad]
  double current = 0;           ///< limit [A]
  double backlash = 0;          ///< of the gear, from flank to flank [rad]
  MotionLimits limits;
};

struct ImuConfiguration {
  double rate = 100;  ///< samples [Hz]
};

/// How camera and IMU sit on the head, as a calibration tells it.
struct RigCalibration {
  Eigen::Quaterniond head_from_camera = nominal_head_from_camera();
  Eigen::Quaterniond head_from_imu = Eigen::Quaterniond::Identity();
  std::chrono::nanoseconds offset{0};  ///< the IMU's stamp of a moment less the camera's
  bool knows_mounts = false;           ///< the file says how both sit; else they are taken to sit straight
  bool knows_offset = false;           ///< likewise

  [[nodiscard]] Eigen::Quaterniond camera_from_imu() const {
    return head_from_camera.conjugate() * head_from_imu;
  }
};

/// A rig as cairn-rig --config reads it: one that could be built.
struct RigConfiguration {
  std::string name;
  std::chrono::milliseconds period{10};  ///< between setpoints
  /// How long commander, IMU or a drive may be silent before the drives are idled.
  std::chrono::milliseconds commander_deadline{60};
  std::chrono::milliseconds imu_deadline{50};
  std::chrono::milliseconds drive_deadline{50};
  std::optional<ImuConfiguration> imu;  ///< none: the rig has none
  std::array<AxisConfiguration, 2> axes;
  RigCalibration calibration;
  RigTuning tuning;

  [[nodiscard]] const AxisConfiguration& axis(AxisName name) const {
    return axes.at(static_cast<size_t>(name));
  }
  [[nodiscard]] std::vector<odrive::Node> nodes() const { return {axes[0].node, axes[1].node}; }
};

/// Reads a rig from YAML; shoulder.yaml lists the keys. Error kConfiguration, as FILE:LINE: WHAT; REMEDY, for
/// an unknown, missing or repeated key, a number that is none, and whatever no rig can be.
[[nodiscard]] Result<RigConfiguration> read_rig_configuration(const std::filesystem::path& path);
/// YAML from which the same is read, with the defaults of optional keys.
[[nodiscard]] std::string write_rig_configuration(const RigConfiguration& rig);

}  // namespace cairn
