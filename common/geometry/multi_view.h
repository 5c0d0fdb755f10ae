// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Multi-view initialization: the points of a first view, in a further one of the same camera.
struct FurtherView {
  double baseline_fraction = 1;  ///< share of the motion to the last view that was made by then: where the
                                 ///< search for its pose begins
  std::vector<Eigen::Vector2d> pixels;  ///< one per point, finite
};

/// Points of one view and where they are in further ones, the last of which is the other of the pair.
struct MultiView {
  std::vector<Eigen::Vector2d> first;  ///< pixels
  std::vector<FurtherView> further;    ///< at least one
};

/// What a motion of the pair (find_motions) became when it was adjusted to all views.
struct AdjustedMotion {
  SE3 last_from_first;         ///< |translation| = 1
  double cost = 0;             ///< Tukey's, with one cut-off for all the motions [px^2]
  double direction_sigma = 0;  ///< [rad] standard deviation of the direction of the baseline, where it is
                               ///< least certain
  double depth_sigma = 0;      ///< standard deviation of a point's distance over the distance; median of the
                               ///< points. Of the noise, the poses' own uncertainty included, and of what no
                               ///< noise tells of: a calibration or a shutter that stretches or shears all
                               ///< images alike, which spoils depths as the camera turns
};

struct MotionsAdjusted {
  std::vector<AdjustedMotion> motions;  ///< one per motion given, in their order
  double noise_cost = 0;                ///< [px^2] cost below which a difference is taken for chance
};

/// Adjusts each motion, with the poses of all further views and the points' inverse distances from the first
/// (Civera, Davison and Montiel, T-RO 2008, with the first view's ray for certain), to the least robust
/// reprojection error, from the start that the motion gives. A point that would lie behind stays at infinity:
/// its error is what the motion pays for it. Two motions of a plane predict different images on the way,
/// unless that is straight. Pure; safe to call from any thread.
[[nodiscard]] MotionsAdjusted adjust_motions(const Camera& camera, const MultiView& views,
                                             std::span<const SE3> last_from_first);

/// The cheapest of the adjusted motions; null when another one, not the same, costs hardly more, and for
/// none.
[[nodiscard]] const AdjustedMotion* clear_best(const MotionsAdjusted& adjusted);

}  // namespace cairn
