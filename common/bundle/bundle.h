// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "common/bundle/free_camera.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

/// Bundle adjustment as a problem of numbers: no map, no ids.
namespace cairn {

struct BundlePose {
  SE3 camera_from_map;
  CameraPtr camera;
  bool fixed = false;
  int free_camera = -1;  ///< index in BundleProblem::free_cameras of this camera; -1: its values are exact
};

struct BundleObservation {
  int pose = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< level-0 px
  double inverse_sigma = 1.0;                       ///< [1/px]
};

struct BundleProblem {
  std::vector<BundlePose> poses;
  std::vector<Eigen::Vector3d> points;  ///< map frame
  std::vector<bool> fixed_points;       ///< those that do not move; empty: all move
  std::vector<BundleObservation> observations;
  std::vector<FreeCamera> free_cameras;  ///< adjusted too, within their priors

  [[nodiscard]] bool is_fixed_point(size_t i) const { return i < fixed_points.size() && fixed_points[i]; }
};

struct BundleOptions {
  int max_iterations = 20;
  double function_tolerance = 1e-4;  ///< relative decrease of the cost at which an iteration is the last
  double min_squared_cutoff = 0.25;  ///< floor of Tukey's squared cut-off, units of sigma
  /// Times that the robust scale is estimated. All rounds but the last are of two iterations: a scale from
  /// bad start values is wide enough to keep outliers, and minimizing to the end with it lets them win.
  int rounds = 1;
  std::function<bool()> should_stop;  ///< polled about every millisecond; the last whole iteration is kept
};

struct BundleReport {
  bool usable = false;      ///< finite and not worse; otherwise the problem is as it was
  bool converged = false;   ///< false: stopped by should_stop or by max_iterations
  double initial_cost = 0;  ///< tukey_cost, summed, at the cut-off of the last round; and the priors
  double final_cost = 0;
  double squared_cutoff = 0;  ///< of the last round, units of sigma
  int iterations = 0;
  int observations = 0;
};

/// Minimizes the sum of Tukey's cost of whitened reprojection errors over the poses and points that are not
/// fixed and the intrinsics of free cameras (these with their priors), in place; the covariance of free
/// cameras is that of the M-estimate (Huber 1981, 7.6) with everything else re-adjusted, its noise that of
/// the residuals. Levenberg-Marquardt with points eliminated first (Schur complement; Triggs et al.
/// 2000, 6.1); Tukey's cut-off by the median of the residuals (PTAM r114). At least one pose, or three
/// points, should be fixed. One thread; equal inputs give equal bytes.
BundleReport solve_bundle(BundleProblem* problem, const BundleOptions& options);

/// Squared whitened reprojection error; infinite where the point does not project.
[[nodiscard]] double squared_residual(const BundleProblem& problem, const BundleObservation& observation);
/// The squared_residual() of every observation, in order.
[[nodiscard]] std::vector<double> squared_residuals(const BundleProblem& problem);

}  // namespace cairn
