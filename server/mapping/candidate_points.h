// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/map/extent.h"
#include "common/map/observations.h"
#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// Makes points of candidates: corners that a tracker has followed until it knew their depth.
namespace cairn {

/// Makes points of the candidates of a keyframe that has just been taken in, where the map has none. Each is
/// looked for in a few other keyframes that should show it, only at the depths that its own sigma allows. A
/// candidate is refused if none of them shows it where it should be, or if even these leave its depth
/// uncertain. Where no other keyframe can show it the tracker's depth counts, if it is as good as that of two
/// views a degree apart. All images are needed: where some have been evicted, nothing is made. Returns ids in
/// order of creation. `extent`: in which the points must be; nothing: everywhere.
[[nodiscard]] std::vector<PointId> make_candidate_points(MapState* map, KeyframeId keyframe,
                                                         std::span<const PointCandidate> candidates,
                                                         const std::optional<Extent>& extent,
                                                         const MapMakerOptions& options);

}  // namespace cairn
