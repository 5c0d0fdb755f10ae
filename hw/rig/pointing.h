// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <variant>

#include "hw/rig/attitude.h"
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
/// A fixed direction of the world, of any length above 0.
struct Lock {
  Eigen::Vector3d direction;
};
}  // namespace pointing
using Pointing = std::variant<pointing::Neutral, pointing::Jog, pointing::Lock>;

/// What the axes are told now, pan and tilt. Lock follows the attitude, with the gyro as feed-forward, and
/// not the encoders: the gear's backlash is larger than what is to be held. Until the attitude is known it
/// stays where it is. `pan`: where pan stands [rad], for directions straight up and down. Pure.
[[nodiscard]] std::array<Demand, 2> demands_of(const Pointing& pointing, const Attitude& attitude,
                                               double pan);

}  // namespace cairn
