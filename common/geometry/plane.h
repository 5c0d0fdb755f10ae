// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "common/base/result.h"
#include "common/geometry/se3.h"

namespace cairn {

struct PlaneFit {
  SE3 plane_from_map;  ///< the plane becomes Z = 0, the cameras lie at Z > 0, the inliers' mean is the origin
  int inliers = 0;
};

/// Dominant plane by RANSAC (triples, truncated distance score) and refinement on the inliers' covariance
/// (PTAM r114). `viewpoint` (a camera centre) gets Z > 0. Error kDegenerate below 10 points or when no plane
/// holds 20 % of them.
[[nodiscard]] Result<PlaneFit> fit_dominant_plane(std::span<const Eigen::Vector3d> points,
                                                  const Eigen::Vector3d& viewpoint, double inlier_distance,
                                                  int trials = 200, uint64_t seed = 1);

}  // namespace cairn
