// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "common/base/result.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Least-squares similarity (or, with `with_scale` false, rigid motion: scale 1) that takes `from` to `to`
/// (Umeyama, PAMI 1991; Eigen's). Error kDegenerate for fewer than 3 points or points on one line or in one
/// place.
[[nodiscard]] Result<Similarity3> align_points(std::span<const Eigen::Vector3d> from,
                                               std::span<const Eigen::Vector3d> to, bool with_scale);

}  // namespace cairn
