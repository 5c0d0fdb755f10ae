// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "server/relocalization/refine.h"

/// Whether a pose is the best there is around it, and how far it may be off.
namespace cairn {

/// Options of settle(). A pose counts as wrong if it is off by more than ConfirmOptions::most_sigma. Where no
/// reason is given, a value is chosen, not measured.
struct SettleOptions {
  /// [depth, or rad] Distance of the starts from the pose: twice what makes a pose wrong.
  double aside = 0.06;
  int most_moves = 3;  ///< most moves to a better pose
  /// Share of the pose's support that a pose from aside needs, by the sample, to be refined: the sample is
  /// rough.
  double nearly_as_good = 0.9;
  uint64_t most_refined = 3;  ///< most of the poses found from the starts that are refined in a move
  uint64_t sampled = 150;     ///< points by which the poses are compared before one is refined
  /// [px of the corner's level] Radii of the search from a start: the first and the last of RefineOptions.
  std::array<double, 2> radii = {6, 2.5};
  /// [depth, or rad] Poses that lie nearer to each other (separation()) count as one: a fifth of what makes a
  /// pose wrong.
  double same = 0.006;
};

/// Standard deviation of the camera's position along the direction in which it is known least [map unit];
/// infinite where nothing determines it. What lies in one cell of the image shares its errors: it is one
/// surface, seen from the same keyframes and matched in the same way. So each cell counts as one measurement,
/// however many points were found in it, and none is better than the corners' own sigma.
[[nodiscard]] double position_sigma(const PlaceView& view, const Camera& camera, const Refined& refined);

/// Searches from around a refined pose for one that explains more, goes there, and repeats this. Agreeing
/// corners may hold a pose that is not the best, as where a thing repeats, or where a few points that the map
/// has wrong hold what the many leave open. The search starts where the image would look much the same:
/// turned about what is seen, nearer and farther. `depth` [map unit] of what is seen; `keyframe`: index into
/// those of the map. Deterministic.
[[nodiscard]] Refined settle(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                             const IndexedMap& map, size_t keyframe, Refined refined, double depth,
                             const SettleOptions& options, const RefineOptions& refining,
                             const MatchOptions& matching);

/// A pose estimate with zero covariance: nothing is in doubt as yet.
[[nodiscard]] PoseEstimate as_certain(const SE3& camera_from_map);

}  // namespace cairn
