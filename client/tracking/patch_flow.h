// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "common/image/frame_images.h"

namespace cairn {

struct PatchFlowOptions {
  int coarsest_level = 2;       ///< 8x8 px are 32 of level 0 there
  int required_level = 1;       ///< at which it must be found
  float search_radius = 10;     ///< [px of level 0] (PTAM r114)
  float way_back_error = 1.0F;  ///< [level px] at most (PTAM: sqrt 2, without sub-pixel)
  int iterations = 8;           ///< of an alignment
};

/// The place in `now` of what `previous` shows at `from`, looked for around `expected`, all in level-0 px. It
/// is followed level by level from coarse to fine, each bringing the next near enough, with a check that the
/// way back ends where it began. Noise and blur may leave nothing to align at level 0; then the place is that
/// of level 1, good to half a pixel. Nothing where it is found at neither.
[[nodiscard]] std::optional<Eigen::Vector2f> follow_patch(const FrameImages& previous, const FrameImages& now,
                                                          const Eigen::Vector2f& from,
                                                          const Eigen::Vector2f& expected,
                                                          const PatchFlowOptions& options);

/// Moves a level-0 pixel of an image as its small image has moved. `image` gives the size only.
[[nodiscard]] Eigen::Vector2f moved_by(const TinyMotion& motion, const Eigen::Vector2f& pixel,
                                       const GrayImage& image);

}  // namespace cairn
