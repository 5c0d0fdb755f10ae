// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/geometry/two_view.h"

namespace cairn {

/// The same points in a further view of the camera, taken between the two of a pair.
struct ThirdView {
  double way = 0.5;  ///< share of the way from a to b: where the search for its pose begins
  std::vector<Eigen::Vector2d> pixels;  ///< one per match of the pair
};

/// How well each motion of a pair (find_motions) explains further views.
struct MotionChoice {
  size_t best = 0;
  bool decided = false;      ///< noise does not explain the difference to the second best
  std::vector<double> cost;  ///< sum of truncated squared residuals in units of sigma, one per motion
  size_t residuals = 0;      ///< summed in each
};

/// Tells apart the motions that explain two views: points triangulated under each are resected in the further
/// views (a plane's two motions predict different pictures there, unless all views lie on a line at constant
/// velocity). Only points that all motions have count. Pure; safe to call from any thread.
[[nodiscard]] MotionChoice choose_motion(const Camera& camera, std::span<const PixelMatch> matches,
                                         std::span<const SE3> b_from_a, std::span<const ThirdView> views,
                                         double sigma);

}  // namespace cairn
