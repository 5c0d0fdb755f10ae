// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <span>

#include "common/base/result.h"
#include "hw/rig/kinematics.h"

namespace cairn {

/// The camera's pose at one place of the axes, seen while the base stood still.
struct Glance {
  PanTilt angles;  ///< of the encoders
  Eigen::Quaterniond map_from_camera;
  Eigen::Vector3d camera_in_map;  ///< its centre [the map's unit]
};

/// How the camera sits on the head, which the tilt axis turns, and how the base stood.
struct HandEye {
  Eigen::Quaterniond head_from_camera;
  Eigen::Vector3d camera_in_head;  ///< from where the axes cross [the map's unit]
  Eigen::Quaterniond map_from_base;
  Eigen::Vector3d base_in_map;
  double rotation_residual = 0;  ///< RMS [rad]
  double position_residual = 0;  ///< RMS [the map's unit]
  size_t used = 0;               ///< of the glances: those that fit
};

/// Finds it from glances at one map, in any order. Errors: kRefused for fewer than 8 of them, for pan or tilt
/// that hardly differ (10 degrees are needed), and where more than a third of them does not fit the others;
/// the message says what to do. Pure.
[[nodiscard]] Result<HandEye> calibrate_hand_eye(std::span<const Glance> glances);

}  // namespace cairn
