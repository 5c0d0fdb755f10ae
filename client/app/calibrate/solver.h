// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

namespace cairn {

/// What one image shows of a plane board: points of the board [any unit, z = 0] and the pixels where they
/// are seen.
struct BoardView {
  std::vector<Eigen::Vector3d> on_board;
  std::vector<Eigen::Vector2d> pixels;  ///< as many
  [[nodiscard]] size_t size() const { return pixels.size(); }
};

/// How one view came out of the calibration.
struct SolvedView {
  SE3 camera_from_board;      ///< in the board's unit of length
  double rms = 0;             ///< [px], of its inliers
  std::vector<bool> inliers;  ///< of the view's points; none: the view was left out
};

struct BoardCalibration {
  CameraParameters parameters;
  std::vector<double> sigma;  ///< standard deviations of parameters.values, from the residuals' own size
  double rms = 0;             ///< root of the mean squared distance of inliers [px]
  std::vector<SolvedView> views;
};

/// Calibrates a camera of `model` (pinhole-radtan with k1 k2 p1 p2, or kb4) from views of a plane board:
/// after a search over focal lengths with poses from homographies (Zhang, PAMI 2000), Levenberg-Marquardt
/// over all poses and the camera, the poses eliminated; points off by more than 4.5 robust sigmas and views
/// off as a whole are left out, once. Pure, deterministic. Errors: kUsage (a model that it does not
/// calibrate), kDegenerate (fewer than 3 views, or they do not determine the camera).
[[nodiscard]] Result<BoardCalibration> calibrate(CameraModel model, ImageSize size,
                                                 const std::vector<BoardView>& views);

}  // namespace cairn
