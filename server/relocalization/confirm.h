// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "server/relocalization/match.h"

namespace cairn {

struct ConfirmOptions {
  int min_supported = 6;  ///< matches that moved as their neighbours did, without which no pose is tried
  int ransac_iterations = 300;
  int min_agreeing = 12;  ///< of all matches by descriptors alone, with the pose
  int min_inliers = 30;   ///< of the refined pose
  int min_cells = 5;      ///< of the 4x3 cells of the image, in which inliers lie
  /// A pose is believed when two witnesses that know nothing of each other speak for it: alikeness()
  /// (appearance.h), and the share of inliers among the corners on which a point falls. Either of two ways.
  struct Witnesses {
    double alikeness = 0;
    double share = 0;
    int agreeing = 0;
  };
  Witnesses by_picture = {0.87, 0.35, 12};  ///< looks the same; things there hide points of each other
  Witnesses by_corners = {0.70, 0.47, 25};  ///< seen from aside or partly hidden, by many corners
  uint64_t seed = 1;
};

/// What geometry says of a keyframe as the place of a query.
struct Confirmation {
  bool confirmed = false;
  SE3 camera_from_map;
  int matches = 0;    ///< by descriptors alone
  int supported = 0;  ///< of these, by their neighbours
  int agreeing = 0;   ///< of all, with the pose from three that are supported
  int inliers = 0;    ///< of the refined pose
  int expected = 0;   ///< points of the neighbourhood that project into the image
  int met = 0;        ///< corners on which one of these falls
  int cells = 0;      ///< of 12, with an inlier in them
  double alikeness = -1;
  std::string reason;  ///< why it is not confirmed
};

/// Corners against the keyframe's points, a pose from three that moved as their neighbours did and with which
/// most agree (P3P in RANSAC), then all points of the keyframes around that pose, and the pose from what is
/// found. `keyframe`: index into those of the map. Deterministic.
[[nodiscard]] Confirmation confirm(const PlaceView& view, std::span<const CellList> cells,
                                   const CornerGrid& grid, const Camera& camera, const IndexedMap& map,
                                   size_t keyframe, const ConfirmOptions& options);

}  // namespace cairn
