// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "server/mapping/map_maker.h"
#include "server/mapping/map_state.h"

/// Judging a frame that wants to become a keyframe, and taking it in.
namespace cairn {

/// The spacing of keyframes: camera distance over mean depth, from the two-view start (PTAM r114).
struct KeyframeSpacing {
  double min_distance_over_depth = 0.1;
};
[[nodiscard]] KeyframeSpacing keyframe_spacing(const MapMakerOptions& options, double first_mean_depth);

/// What integrate_keyframe() would refuse for its reference or its measurements, so that its image need not
/// be decoded; nothing: it takes the image to say. The image of `input` may be null.
[[nodiscard]] std::optional<KeyframeDecision> refuse_without_image(const MapState& map,
                                                                   const KeyframeInput& input);

/// Re-optimizes the pose on the measurements, judges, and on acceptance adds the keyframe with its
/// measurements, refined to sub-pixel, and with every other point of the map that is found in it.
[[nodiscard]] KeyframeDecision integrate_keyframe(MapState* map, const KeyframeInput& input,
                                                  const KeyframeSpacing& spacing);

}  // namespace cairn
