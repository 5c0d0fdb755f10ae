// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "client/tracking/keyframe_policy.h"
#include "client/tracking/point_search.h"
#include "client/tracking/stage.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

/// Whether a frame would make its map grow.
namespace cairn {

/// A young map needs the parallax that a view from `center` has against its keyframes. `mean_depth` [map
/// unit] of what it looks at.
[[nodiscard]] bool widens_map(const MapSnapshot& map, const Eigen::Vector3d& center, double mean_depth);

/// The frame shows enough that the points found in it do not cover, as the map maker judges it.
[[nodiscard]] bool shows_new_area(const FrameImages& frame, std::span<const VisiblePoint> points,
                                  const KeyframePolicyOptions& options, StageProbe* probe);

}  // namespace cairn
