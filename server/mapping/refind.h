// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// Finding known points in keyframes that do not measure them yet.
namespace cairn {

/// Looks for one point in one keyframe, if it should be visible there: within a few px of its projection,
/// sub-pixel (PTAM r114). Adds the measurement, or gives the pair up, and counts the search on the point; a
/// failure in a keyframe that adds only is not counted. Returns whether it searched: false if the point or
/// keyframe is removed, or the pair is measured, given up or out of view.
bool refind(MapState* map, KeyframeId keyframe, PointId point, const RefindOptions& options);

/// Calls refind() for every live point of the map. Returns how many were found.
int refind_all(MapState* map, KeyframeId keyframe, const RefindOptions& options);

/// Whether a point can be expected to look alike from a camera: the direction from the point to
/// `camera_center` is near that to its source keyframe (RefindOptions::visible_cosine). The image's borders
/// and the distance are not considered.
[[nodiscard]] bool should_see(const MapState& map, const MapPoint& point,
                              const Eigen::Vector3d& camera_center, double visible_cosine);

}  // namespace cairn
