// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/se3.h"

namespace cairn {

/// Position of the eye and of what it looks at, map coordinates [m].
struct Waypoint {
  Eigen::Vector3d eye;
  Eigen::Vector3d target;
};

/// A motion from 0 to 1 as `part` goes from 0 to 1, at rest at both ends, twice continuously differentiable:
/// how a hand moves from one point to another (minimum jerk; Flash and Hogan, J. Neuroscience 1985). Its
/// greatest speed is kMinimumJerkPeak times the mean one.
[[nodiscard]] double minimum_jerk(double part);
constexpr double kMinimumJerkPeak = 1.875;

/// The camera turned aside on top of its route, held there and turned back.
struct Turn {
  double begin = 0;                                 ///< s on the clock of the route
  double going = 1;                                 ///< s on the way there, and as long on the way back
  double staying = 0;                               ///< s there
  double yaw = 0;                                   ///< rad, about the vertical of the map, to the left
  double pitch = 0;                                 ///< rad, about the camera's x then, upwards
  double roll = 0;                                  ///< rad, about the optical axis then
  Eigen::Vector3d pivot = Eigen::Vector3d::Zero();  ///< camera coordinates [m]: stays where it is

  [[nodiscard]] double end() const { return begin + 2 * going + staying; }
};

/// The pose with the turns that go on.
[[nodiscard]] SE3 turned(const SE3& map_from_camera, std::span<const Turn> turns, double route_seconds);

/// Seconds on the clock of the route: at speed 1 as long as the hand is calm, then, within a second, at
/// `speed`.
struct RouteClock {
  double speed = 1;
  double calm = 0;  ///< s

  [[nodiscard]] double at(double seconds) const;
  /// The inverse.
  [[nodiscard]] double seconds_at(double route_seconds) const;
};

/// A camera in a hand: a closed route, swayed at up to 2.5 Hz and trembling around 8 Hz (physiological
/// tremor). Every part is twice continuously differentiable, so velocities and accelerations are those of a
/// real body. A pure function of time: thread-safe.
class HandMotion {
 public:
  /// Waypoints are control points of a closed uniform cubic B-spline, passed every `interval` seconds of
  /// the clock: the curve passes near them, not through them. The clock is that of route and sway, not of the
  /// tremor. Needs four waypoints or more; map Z is up. `steadiness` divides sway and tremor.
  HandMotion(std::vector<Waypoint> route, double interval, const RouteClock& clock, uint64_t seed,
             double steadiness = 1);

  /// Pose at a time from the start [s], any real number.
  [[nodiscard]] SE3 map_from_camera(double seconds) const;

 private:
  struct Wave {
    double angular_frequency;
    double phase;
    double amplitude;
  };
  using Waves = std::vector<Wave>;

  [[nodiscard]] static Waves make_waves(double low_hz, double high_hz, int count, double rms, uint64_t seed,
                                        uint64_t stream);
  [[nodiscard]] Waypoint route_at(double route_seconds) const;

  std::vector<Waypoint> route_;
  double interval_;
  RouteClock clock_;
  std::array<Waves, 6> sway_;    ///< translation [m], rotation [rad], camera axes
  std::array<Waves, 6> tremor_;  ///< likewise
};

}  // namespace cairn
