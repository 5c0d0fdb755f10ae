// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace cairn::simulated {

/// A shoulder that sways by 10 degrees about all axes, and goes up and down twice as often, while its wearer
/// walks around a point and faces it. The wearer sets out within a second, and comes to rest within one:
/// nobody is at speed at once. World: z up, the point at the origin, at the height of the shoulder. Base: x
/// forward, y left, z up. Times in seconds since the wearer set out. Pure.
struct Gait {
  double frequency = 0;             ///< of the sway [Hz]; 0: it stands still
  double turn = 0;                  ///< [rad/s] of the wearer about the point
  double radius = 0;                ///< of the way around it [m]
  double begin = 0;                 ///< where on the way: heading of one who faces the point [rad]
  std::optional<double> rest_at{};  ///< from when on the wearer comes to rest: 1 or later

  [[nodiscard]] Eigen::Quaterniond world_from_base(double t) const;
  /// The shoulder's place, from the point [m].
  [[nodiscard]] Eigen::Vector3d position(double t) const;
  /// Heading of one who faces the point, without the sway [rad].
  [[nodiscard]] double heading(double t) const;

 private:
  [[nodiscard]] Eigen::Vector3d steps(double t) const;
  [[nodiscard]] double strength(double t) const;
  [[nodiscard]] double sways() const;
};

/// [rad/s], in the axes of `world_from_body`, a function of time [s].
template <typename Attitude>
[[nodiscard]] Eigen::Vector3d rate_of(const Attitude& world_from_body, double t) {
  constexpr double kStep = 1e-5;
  const Eigen::AngleAxisd turn_of_step(world_from_body(t).conjugate() * world_from_body(t + kStep));
  return turn_of_step.angle() / kStep * turn_of_step.axis();
}

/// [m/s^2], in the world's axes, of a position that is a function of time [s].
template <typename Position>
[[nodiscard]] Eigen::Vector3d acceleration_of(const Position& position, double t) {
  constexpr double kStep = 1e-3;
  const Eigen::Vector3d change = position(t - kStep) - 2 * position(t) + position(t + kStep);
  return change / (kStep * kStep);
}

}  // namespace cairn::simulated
