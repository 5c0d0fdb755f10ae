// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "common/base/result.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Point in the frame of camera a from unit rays in cameras a and b (linear least squares, refined to the
/// minimum of the angular reprojection error). Error kDegenerate when it lies behind a camera or the rays are
/// parallel within 1e-9.
[[nodiscard]] Result<Eigen::Vector3d> triangulate(const SE3& b_from_a, const Eigen::Vector3d& ray_a,
                                                  const Eigen::Vector3d& ray_b);

/// Angle [rad] at the point between the directions to two camera centres: the parallax.
[[nodiscard]] double parallax(const Eigen::Vector3d& point, const Eigen::Vector3d& center_a,
                              const Eigen::Vector3d& center_b);

}  // namespace cairn
