// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include "common/geometry/camera.h"
#include "common/geometry/pose.h"
#include "server/relocalization/match.h"

/// A pose from a few corners of a query, refined by all points around it.
namespace cairn {

/// Chosen, not measured; the last radius is ConfirmOptions::ransac_threshold.
struct RefineOptions {
  uint64_t neighbourhood = 4;  ///< keyframes whose points are looked for around a pose
  double angle_weight = 1;     ///< a radian between optical axes counts as so many mean depths apart
  /// [px of the corner's level] Of the search around a pose, step by step: that of three points is rough yet.
  std::array<double, 3> radii = {6, 4, 2.5};
  double certainty = 3;            ///< [sigma] of where a point is expected, that the radius must hold
  uint64_t enough_for_pose = 200;  ///< points of which a pose is refined, before all are looked for
};

/// How the pixel of a point `seen` in the camera changes with the pose (left tangent: translation,
/// rotation) [px]; nothing for a point that does not project.
[[nodiscard]] std::optional<Eigen::Matrix<double, 2, 6>> pixel_by_pose(const Camera& camera,
                                                                       const Eigen::Vector3d& seen);

/// Of where a pose puts a point of the map, as far as the pose is uncertain [px^2, both axes together];
/// infinite for a point that does not project.
[[nodiscard]] double variance_of_pixel(const Camera& camera, const PoseEstimate& pose,
                                       const Eigen::Vector3d& point);

/// Leaves the points that a search of that radius [px of the point's finest level] finds where they are. A
/// pose from corners that lie close together is known there and not elsewhere: what is looked for elsewhere
/// is matched wrongly, and holds the pose where it is. Precondition: each point has a sighting.
void keep_certain(const Camera& camera, const PoseEstimate& pose, double radius, ProjectedPoints* points,
                  const RefineOptions& options);

/// All that is found around a pose.
struct Refined {
  PoseEstimate pose;       ///< of `guided.matches`
  ProjectedPoints points;  ///< by the pose before that
  GuidedMatches guided;
};

/// The points of the keyframe that a pose comes from and of others around the pose are looked for step by
/// step, as far as each pose can tell where they are; by the last, all. `keyframe`: index into those of the
/// map. Error: the points found do not determine the pose. Deterministic.
[[nodiscard]] Result<Refined> refine(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                                     const IndexedMap& map, size_t keyframe, PoseEstimate pose,
                                     const RefineOptions& options, const MatchOptions& matching);

}  // namespace cairn
