// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include "common/geometry/camera.h"
#include "common/geometry/pose.h"
#include "server/relocalization/match.h"

/// A pose from a few corners of a query, refined by all points around it.
namespace cairn {

/// Options of the refinement of a pose. They are chosen, not measured; the last radius is
/// ConfirmOptions::ransac_threshold.
struct RefineOptions {
  uint64_t neighbourhood = 4;  ///< number of keyframes whose points are looked for around a pose
  /// Number of mean depths that a radian between optical axes counts as, for small angles.
  double angle_weight = 1;
  /// [px of the corner's level] Radii of the search around a pose, step by step: a pose from three points is
  /// rough yet.
  std::array<double, 3> radii = {6, 4, 2.5};
  /// [sigma] A point is searched in a step only if the radius is at least so many sigmas of its expected
  /// pixel; the last step searches all.
  double certainty = 3;
  uint64_t enough_for_pose = 200;  ///< most points that are looked for in a step; the last step looks for all
};

/// Derivative of a point's pixel [px] by the pose (left tangent: translation, rotation); nothing for a point
/// that does not project. `seen`: the point in the camera's frame.
[[nodiscard]] std::optional<Eigen::Matrix<double, 2, 6>> pixel_by_pose(const Camera& camera,
                                                                       const Eigen::Vector3d& seen);

/// Variance of where a pose puts a point of the map, as far as the pose is uncertain [px^2, both axes
/// together]; infinite for a point that does not project.
[[nodiscard]] double variance_of_pixel(const Camera& camera, const PoseEstimate& pose,
                                       const Eigen::Vector3d& point);

/// Removes the points that the pose leaves too uncertain to be found by a search of this radius [px of the
/// point's finest level]. A pose from corners that lie close together is known there and not elsewhere: what
/// is looked for elsewhere is matched wrongly, and holds the pose where it is. Precondition: each point has a
/// sighting.
void keep_certain(const Camera& camera, const PoseEstimate& pose, double radius, ProjectedPoints* points,
                  const RefineOptions& options);

/// A refined pose, and all that was found around it.
struct Refined {
  PoseEstimate pose;       ///< optimized on `guided.matches`
  ProjectedPoints points;  ///< the points that were looked for, projected by the pose before that
  GuidedMatches guided;
};

/// Refines a pose. The points of the keyframe that it comes from and of others around are looked for step by
/// step, as far as each pose can tell where they are; in the last step, all. `keyframe`: index into those of
/// the map. Error: the points found do not determine the pose. Deterministic.
[[nodiscard]] Result<Refined> refine(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                                     const IndexedMap& map, size_t keyframe, PoseEstimate pose,
                                     const RefineOptions& options, const MatchOptions& matching);

}  // namespace cairn
