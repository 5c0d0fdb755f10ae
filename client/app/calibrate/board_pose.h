// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "client/app/calibrate/solver.h"

namespace cairn {

/// The homography that takes board points (x, y, 1) to the given directions, up to scale; nothing for fewer
/// than 4 points or points that do not determine it (Hartley and Zisserman, "Multiple View Geometry",
/// algorithm 4.2).
[[nodiscard]] std::optional<Eigen::Matrix3d> board_homography(const std::vector<Eigen::Vector3d>& on_board,
                                                              const std::vector<Eigen::Vector3d>& directions);

/// Pose of the board as the camera sees it, from the homography of its rays; nothing if they do not determine
/// one.
[[nodiscard]] std::optional<SE3> board_pose(const Camera& camera, const BoardView& view);

}  // namespace cairn
