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

/// A shoulder that sways by 10 degrees about all axes, and goes up and down twice as often, while its wearer
/// walks around a point and faces it. The wearer sets out within a second: nobody is at speed at once.
struct Gait {
  double frequency = 0;  ///< of the sway [Hz]; 0: it stands still
  double turn = 0;       ///< [rad/s] of the wearer
  double radius = 0;     ///< of the way around the point [m]

  [[nodiscard]] Eigen::Quaterniond world_from_base(double t) const {
    using Eigen::AngleAxisd;
    using Eigen::Vector3d;
    const double begun = std::clamp(t, 0.0, 1.0);
    const double strength = begun * begun * (3 - 2 * begun);
    const double sway = strength * std::numbers::pi / 18 * std::sin(2 * std::numbers::pi * frequency * t);
    return Eigen::Quaterniond(AngleAxisd(turned(t) + 0.7 * sway, Vector3d::UnitZ()) *
                              AngleAxisd(sway, Vector3d::UnitY()) *
                              AngleAxisd(0.5 * sway, Vector3d::UnitX()));
  }
  /// [rad/s], in the base's axes.
  [[nodiscard]] Eigen::Vector3d rate(double t) const {
    constexpr double kStep = 1e-5;
    const Eigen::AngleAxisd turn_of_step(world_from_base(t).conjugate() * world_from_base(t + kStep));
    return turn_of_step.angle() / kStep * turn_of_step.axis();
  }
  /// From the point [m].
  [[nodiscard]] Eigen::Vector3d position(double t) const {
    const double bounce = frequency == 0 ? 0 : -kBounce / std::pow(bounces(), 2) * std::sin(bounces() * t);
    return {-radius * std::cos(turned(t)), -radius * std::sin(turned(t)), bounce};
  }
  /// [m/s^2], in the base's axes.
  [[nodiscard]] Eigen::Vector3d acceleration(double t) const {
    const double inward = radius * turn * turn;
    const Eigen::Vector3d of_the_way{inward * std::cos(turned(t)), inward * std::sin(turned(t)),
                                     kBounce * std::sin(bounces() * t)};
    return world_from_base(t).conjugate() * (of_the_way + 9.81 * Eigen::Vector3d::UnitZ());
  }

 private:
  static constexpr double kBounce = 1.5;  // [m/s^2]

  [[nodiscard]] double bounces() const { return 4 * std::numbers::pi * frequency; }
  [[nodiscard]] double turned(double t) const {
    const double begun = std::clamp(t, 0.0, 1.0);
    return turn * (std::pow(begun, 3) - std::pow(begun, 4) / 2 + std::max(0.0, t - 1));
  }
};

}  // namespace cairn::testing
