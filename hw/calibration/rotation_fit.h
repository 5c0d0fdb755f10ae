// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <span>

namespace cairn {

struct VectorPair {
  Eigen::Vector3d from;
  Eigen::Vector3d to;
};

/// `to` = rotation * `from` + offset, in the sense of least squares.
struct RotationFit {
  Eigen::Quaterniond rotation;
  Eigen::Vector3d offset;
  double residual = 0;  ///< sum of squares
  double about = 0;  ///< RMS of `from` about its mean in the second of its main directions: 0: the rotation
                     ///< about the first is not known
};

/// Fits a rotation and an offset to two pairs at least.
[[nodiscard]] RotationFit fit_rotation(std::span<const VectorPair> pairs);

}  // namespace cairn
