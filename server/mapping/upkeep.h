// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// Upkeep of a map as it grows: removal of points and keyframes that add nothing.
namespace cairn {

/// Removes points that were searched in many keyframes and found in few. Returns how many.
int cull_points(MapState* map, const UpkeepOptions& options);

/// Finds a keyframe that adds next to nothing: at least 90 % of its points do not have their patch from it
/// and are measured at the same or a finer level in three others (Mur-Artal et al., T-RO 2015, VI-E), none of
/// which adds only. It is never one of the first two or the newest few. It is looked for among those that
/// share points with `newest`, whose arrival may have made them so. These numbers are of `options`.
[[nodiscard]] std::optional<KeyframeId> find_redundant_keyframe(const MapState& map, KeyframeId newest,
                                                                const UpkeepOptions& options);

}  // namespace cairn
