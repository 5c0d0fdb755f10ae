// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace cairn {

/// Which way is up, as an accelerometer says.
struct UpDirection {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();  ///< away from the earth, length 1; of a camera: its axes
  double sigma = 0;                              ///< [rad], per axis
};

/// The same direction in other axes.
[[nodiscard]] inline UpDirection turned(const Eigen::Quaterniond& there_from_here, const UpDirection& here) {
  return {there_from_here * here.up, here.sigma};
}

/// [rad], 0 to pi.
[[nodiscard]] inline double angle_between(const UpDirection& a, const UpDirection& b) {
  return std::atan2(a.up.cross(b.up).norm(), a.up.dot(b.up));
}

}  // namespace cairn
