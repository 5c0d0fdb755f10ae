// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/relocalization/refine.h"

/// Whether a pose is the best there is around it, and how far it may be off.
namespace cairn {

/// Standard deviation of the camera's position along the direction in which it is known least [map unit];
/// infinite where nothing determines it. What lies in one cell of the image shares its errors: it is one
/// surface, seen from the same keyframes and matched in the same way. So each cell counts as one measurement,
/// however many points were found in it, and none is better than the corners' own sigma.
[[nodiscard]] double position_sigma(const PlaceView& view, const Camera& camera, const Refined& refined);

/// Looks from around a refined pose for one that explains more, and goes there, again and again: what agrees
/// may hold a pose that is not the best, as where a thing repeats, or where a few points that the map has
/// wrong hold what the many leave open. It starts where the image would look much the same, since the eye
/// is held on it: turned about what is seen, nearer and farther. `depth` [map unit] of what is seen;
/// `keyframe`: index into those of the map. Deterministic.
[[nodiscard]] Refined settle(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                             const IndexedMap& map, size_t keyframe, Refined refined, double depth);

/// A pose of which nothing is in doubt as yet.
[[nodiscard]] PoseEstimate as_certain(const SE3& camera_from_map);

}  // namespace cairn
