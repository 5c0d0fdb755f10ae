// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/se3.h"

namespace cairn {

/// Where the eye is and what it looks at, map coordinates [m].
struct Waypoint {
  Eigen::Vector3d eye;
  Eigen::Vector3d target;
};

/// A camera in a hand: a closed route, swayed at up to 2.5 Hz and trembling around 8 Hz (physiological
/// tremor). Every part is twice continuously differentiable, so velocities and accelerations are those of a
/// real body. A pure function of time: thread-safe.
class HandMotion {
 public:
  /// Waypoints are control points of a closed uniform cubic B-spline, passed every `interval` seconds at
  /// speed 1: the curve passes near them, not through them. `speed` scales route and sway, not the tremor.
  /// Needs four waypoints or more; map Z is up. `steadiness` divides sway and tremor.
  HandMotion(std::vector<Waypoint> route, double interval, double speed, uint64_t seed,
             double steadiness = 1);

  /// Pose at a time from the start [s], any real number.
  [[nodiscard]] SE3 map_from_camera(double seconds) const;

  /// Seconds until the route begins again.
  [[nodiscard]] double period() const;

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
  double speed_;
  std::array<Waves, 6> sway_;    ///< translation [m], rotation [rad], camera axes
  std::array<Waves, 6> tremor_;  ///< likewise
};

}  // namespace cairn
