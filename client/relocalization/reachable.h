// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/base/time.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Where a camera was and how it moved when that was proven last.
struct ProvenMotion {
  Timestamp time;
  SE3 camera_from_map;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< of the centre, map frame [map unit/s]
  double turn_rate = 0;                                ///< [rad/s], whatever the axis
  double depth = 1;                                    ///< [map unit] of what is seen
};

/// How a camera may change its motion for as long as it is hidden. Maps have units of their own, so lengths
/// are in depths. A person starts or stops walking within a step: 1.4 m/s in 0.5 s, which is 3 m/s^2, of what
/// is seen 2 m away 1.5 depths/s^2. A wrist turns 60 degrees in 0.4 s by the minimum-jerk course of Flash and
/// Hogan (J. Neuroscience 1985): up to 5.77 * 1.05 / 0.4^2 = 38 rad/s^2, half of the time against the way it
/// went. An arm before something near is faster for a moment: its pose counts as beyond, and has to show
/// more.
struct HandMotion {
  double acceleration = 1.5;        ///< that lasts [depths/s^2]
  double turn_acceleration = 20.0;  ///< that lasts [rad/s^2]
};

/// A pose that was suggested for a frame.
struct SuggestedPose {
  Timestamp time;
  SE3 camera_from_map;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of the centre, map frame
};

/// Whether a camera can have got to a pose since it was proven elsewhere, and what the pose must show if not.
struct Reach {
  bool is_reachable = false;
  /// How far the pose lies beyond what can be reached [depths, and radians]; 0: it does not.
  double beyond = 0;
  /// So many times what the map shows from the best pose that can be reached must be found by this one, for a
  /// structure that repeats shows as much at each of its periods. 1: the pose is as good as any.
  double needed_margin = 1;
};

/// The camera went on as it did, stopped, or anything between, and changed that as a hand can: the centre
/// lies near the line from where it was to where it would be. Time that runs back says nothing: all is
/// reachable.
[[nodiscard]] Reach reach(const ProvenMotion& from, const SuggestedPose& to, const HandMotion& hand = {});

}  // namespace cairn
