// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "common/geometry/se3.h"
#include "common/geometry/up_direction.h"
#include "common/map/keyframe_view.h"
#include "common/map/snapshot.h"

/// Checks poses by gravity: an image that fits a place only with the camera held otherwise than it was held
/// is of another place.
namespace cairn {

struct GravityOptions {
  /// [squared sigmas] Largest squared angle at which two directions agree: 99.9 % of two degrees of freedom.
  double chi_square = 13.816;
  /// [rad] Sigma of the tilt of a pose from few matches, and of how an IMU is known to sit on its camera.
  double pose_tilt = 0.03;
  /// Share of the keyframes that may contradict the rest: with more, nobody knows which way is up in the map.
  /// Chosen, not measured.
  double most_contradict = 0.25;
  /// [rad] Least sigma of the up direction of a map: what the measurements of one accelerometer have in
  /// common, its bias, does not average out.
  double common_sigma = 0.01;
};

/// Which way is up in a map: the mean of what its keyframes measured, weighted by their certainty. Nothing
/// where none did, or where too many contradict the rest, as when IMUs sit otherwise than they say.
[[nodiscard]] std::optional<UpDirection> up_in_map(const MapSnapshot& snapshot,
                                                   std::span<const KeyframeView> views,
                                                   const GravityOptions& options);

/// Whether a camera that measured `seen` can have this pose in a map where up is `in_map`: the angle between
/// what it measured and what it should have is within what chance allows. True where either is not known.
[[nodiscard]] bool is_upright(const SE3& camera_from_map, const std::optional<UpDirection>& in_map,
                              const std::optional<UpDirection>& seen, const GravityOptions& options);

}  // namespace cairn
