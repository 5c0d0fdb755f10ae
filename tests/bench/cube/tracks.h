// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/image/image.h"
#include "tests/bench/cube/adjust.h"
#include "tests/bench/cube/dots.h"

namespace cairn::cube {

struct TrackOptions {
  int references = 5;  ///< views from which patches are taken, spread over the sequence
  size_t patches_per_view = 150;
  int spacing = 10;               ///< least distance between two patches of a view [px]
  double keep_off_dots = 10;      ///< least distance of a patch's centre to a dot [px]
  double min_correlation = 0.95;  ///< of the patch in a view with its reference, after gain and bias
  size_t min_length = 8;          ///< views
};

/// Follows patches of the scene, dots left out, through the given frames (`views`, ascending): each from the
/// view that it was cut from to either side, aligned with that view's pixels (not with the last view's, so
/// nothing drifts) by an affine warp with gain and bias (inverse compositional, Baker and Matthews, IJCV
/// 2004) on cubic samples. `dots`: the sightings of these frames; their mean motion predicts a patch's.
[[nodiscard]] std::vector<Track> follow_patches(const std::vector<GrayImage>& frames,
                                                const std::vector<int>& views,
                                                const std::vector<DotSighting>& dots,
                                                const TrackOptions& options = {});

}  // namespace cairn::cube
