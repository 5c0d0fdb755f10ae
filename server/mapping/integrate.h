// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/mapping/map_maker.h"
#include "server/mapping/map_state.h"

/// Judging a frame that wants to become a keyframe, and taking it in.
namespace cairn {

/// The spacing of keyframes: camera distance over mean depth, from the two-view start (PTAM r114).
struct KeyframeSpacing {
  double min_distance_over_depth = 0.1;
};
[[nodiscard]] KeyframeSpacing keyframe_spacing(const MapMakerOptions& options, double first_mean_depth);

/// Judges a frame and takes it in. Re-optimizes its pose on the measurements; if accepted, adds the keyframe
/// with its measurements, refined to sub-pixel, and with every other point of the map that is found in it. A
/// frame that is refused for its reference or its measurements needs no image: `decode` is not called for it,
/// unless it is chained and its reference is there.
[[nodiscard]] KeyframeDecision integrate_keyframe(MapState* map, const KeyframeInput& offered,
                                                  const KeyframeSpacing& spacing, const DecodeImage& decode,
                                                  const MapMakerOptions& options);

}  // namespace cairn
