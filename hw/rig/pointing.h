// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <variant>

#include "hw/rig/base_motion.h"
#include "hw/rig/kinematics.h"
#include "hw/rig/motion_profile.h"

namespace cairn {

/// What the camera is to look at.
namespace pointing {
/// Ahead, as the configuration says.
struct Neutral {
  PanTilt angles;
};
/// By hand.
struct Jog {
  PanTilt rates;  ///< [rad/s]
};
/// A fixed direction of the world, of any length above 0; without one, that in which the camera looks when it
/// begins.
struct Lock {
  std::optional<Eigen::Vector3d> direction;
};
}  // namespace pointing
using Pointing = std::variant<pointing::Neutral, pointing::Jog, pointing::Lock>;

/// What the axes are told, pan and tilt, for `ahead` [s] after the IMU's newest sample. Lock follows the
/// motion of the base, and stays where it is until that is known. `pan`: where pan stands [rad], for
/// directions straight up and down. Pure.
[[nodiscard]] std::array<Demand, 2> demands_of(const Pointing& pointing, const BaseMotion& base, double ahead,
                                               double pan);

}  // namespace cairn
