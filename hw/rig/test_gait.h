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
    const double sway = strength(t) * std::numbers::pi / 18 * std::sin(sways() * t);
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
    return radius * ahead(t) * -1 + steps(t, -1 / std::max(1e-9, std::pow(sways(), 2)));
  }
  /// [m/s^2], in the base's axes.
  [[nodiscard]] Eigen::Vector3d acceleration(double t) const {
    return world_from_base(t).conjugate() *
           (radius * turn * turn * ahead(t) + steps(t, 1) + 9.81 * Eigen::Vector3d::UnitZ());
  }

 private:
  /// The wearer goes up and down and to and fro twice, and from side to side once, in each sway:
  /// accelerations [m/s^2], or, with -1 over the square of the sway's angular frequency, the way [m].
  [[nodiscard]] Eigen::Vector3d steps(double t, double factor) const {
    if (frequency == 0) return Eigen::Vector3d::Zero();
    const double twice = factor < 0 ? factor / 4 : factor;
    return strength(t) * Eigen::Vector3d(1.0 * twice * std::sin(2 * sways() * t + 1),
                                         1.5 * factor * std::cos(sways() * t),
                                         4.0 * twice * std::sin(2 * sways() * t));
  }
  [[nodiscard]] Eigen::Vector3d ahead(double t) const {
    return {std::cos(turned(t)), std::sin(turned(t)), 0};
  }
  static double strength(double t) {
    const double begun = std::clamp(t, 0.0, 1.0);
    return begun * begun * (3 - 2 * begun);
  }
  [[nodiscard]] double sways() const { return 2 * std::numbers::pi * frequency; }
  [[nodiscard]] double turned(double t) const {
    const double begun = std::clamp(t, 0.0, 1.0);
    return turn * (std::pow(begun, 3) - std::pow(begun, 4) / 2 + std::max(0.0, t - 1));
  }
};

}  // namespace cairn::testing
