// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

// For tests only.
namespace cairn::testing {

inline double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// A shoulder that sways by 10 degrees about all axes, and goes up and down twice as often. It sets out
/// within a second: nobody is at speed at once.
struct Gait {
  double frequency;  ///< [Hz]; 0: it stands still

  [[nodiscard]] Eigen::Quaterniond world_from_base(double t) const {
    using Eigen::AngleAxisd;
    using Eigen::Vector3d;
    const double begun = std::clamp(t, 0.0, 1.0);
    const double strength = begun * begun * (3 - 2 * begun);
    const double sway = strength * std::numbers::pi / 18 * std::sin(2 * std::numbers::pi * frequency * t);
    return Eigen::Quaterniond(AngleAxisd(0.7 * sway, Vector3d::UnitZ()) *
                              AngleAxisd(sway, Vector3d::UnitY()) *
                              AngleAxisd(0.5 * sway, Vector3d::UnitX()));
  }
  /// [rad/s], in the base's axes.
  [[nodiscard]] Eigen::Vector3d rate(double t) const {
    constexpr double kStep = 1e-5;
    const Eigen::AngleAxisd turn(world_from_base(t).conjugate() * world_from_base(t + kStep));
    return turn.angle() / kStep * turn.axis();
  }
  /// [m/s^2], in the base's axes.
  [[nodiscard]] Eigen::Vector3d acceleration(double t) const {
    const double bounce = 1.5 * std::sin(4 * std::numbers::pi * frequency * t);
    return world_from_base(t).conjugate() * ((9.81 + bounce) * Eigen::Vector3d::UnitZ());
  }
};

}  // namespace cairn::testing
