// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/map/extent.h"
#include "common/map/observations.h"
#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// Points of what a tracker has followed until it knew the depth.
namespace cairn {

/// Makes points of the candidates of a keyframe that has just been taken in, where the map has none. Each is
/// looked for in a few other keyframes that should show it, only at the depths that its own leaves open. What
/// none of them shows where it should be is refused, and so is what even these leave uncertain. Where no
/// other keyframe can show it the tracker's word counts, if it is as good as that of two views a degree
/// apart. All images are needed: where some have been evicted, nothing is made. Ids in order of creation.
/// `extent`: in which they must be; nothing: everywhere.
[[nodiscard]] std::vector<PointId> make_candidate_points(MapState* map, KeyframeId keyframe,
                                                         std::span<const PointCandidate> candidates,
                                                         const std::optional<Extent>& extent,
                                                         const MapMakerOptions& options);

}  // namespace cairn
