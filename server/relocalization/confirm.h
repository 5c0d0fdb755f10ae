// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "server/relocalization/match.h"

namespace cairn {

struct ConfirmOptions {
  int min_matches = 8;  ///< of descriptors alone, without which no pose is tried
  int ransac_iterations = 1000;
  int ransac_inliers = 12;
  int min_inliers = 30;     ///< of the refined pose
  double min_share = 0.10;  ///< inliers, of the points that should be in view or of the corners if fewer
  int min_cells = 5;        ///< of the 4x3 cells of the image, in which inliers lie
  uint64_t seed = 1;
};

/// What geometry says of a keyframe as the place of a query.
struct Confirmation {
  bool confirmed = false;
  SE3 camera_from_map;
  int corners = 0;     ///< of the query
  int matches = 0;     ///< by descriptors alone
  int agreeing = 0;    ///< of these, with the pose from three of them
  int inliers = 0;     ///< of the refined pose
  int expected = 0;    ///< points of the neighbourhood that project into the image
  int cells = 0;       ///< of 12, with an inlier in them
  std::string reason;  ///< why it is not confirmed
};

/// Corners against the keyframe's points, a pose from three of them that most agree with (P3P in RANSAC),
/// then all points of the keyframes around that pose, and the pose from what is found. Deterministic.
[[nodiscard]] Confirmation confirm(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                                   const IndexedMap& map, const IndexedKeyframe& keyframe,
                                   const ConfirmOptions& options);

}  // namespace cairn
