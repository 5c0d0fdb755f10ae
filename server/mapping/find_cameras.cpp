// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/find_cameras.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr double kWellKnown = 0.03;  ///< sigma of log f below which other starts are not tried
constexpr std::array<double, 4> kOtherStarts{0.6, 0.8, 1.25, 1.6};  ///< factors on the focal length

/// Another focal length for one camera, and what an affine camera could not tell from before: depth along
/// the first camera's axis stretched by the same factor, turns of the camera shrunk by it (the bas-relief
/// ambiguity).
void stretch(size_t camera, double factor, BundleProblem* problem) {
  FreeCamera& free_camera = problem->free_cameras[camera];
  Intrinsics intrinsics = intrinsics_of(*free_camera.camera);
  intrinsics[0] += std::log(factor);
  free_camera.camera = with_intrinsics(*free_camera.camera, within_reach(free_camera, intrinsics));
  const SE3 first_from_map = problem->poses.front().camera_from_map;
  const SE3 map_from_first = first_from_map.inverse();
  const Eigen::Vector3d scale(1, 1, factor);
  const Eigen::Vector3d turn(1 / factor, 1 / factor, 1);
  for (Eigen::Vector3d& p : problem->points) p = map_from_first * scale.cwiseProduct(first_from_map * p);
  for (BundlePose& pose : problem->poses) {
    if (pose.free_camera == static_cast<int>(camera)) pose.camera = free_camera.camera;
    const SE3 first_from_camera = first_from_map * pose.camera_from_map.inverse();
    const Eigen::Vector3d rotation = turn.cwiseProduct(so3_log(first_from_camera.rotation()));
    const SE3 stretched(so3_exp(rotation), scale.cwiseProduct(first_from_camera.translation()));
    if (!pose.fixed) pose.camera_from_map = stretched.inverse() * first_from_map;
  }
}

double cost_at(const BundleProblem& problem, double squared_cutoff) {
  double sum = 0;
  for (const FreeCamera& c : problem.free_cameras) sum += prior_cost(c, *c.camera, squared_cutoff);
  for (const double s : squared_residuals(problem)) sum += tukey_cost(s, squared_cutoff);
  return sum;
}

/// Solves from other focal lengths too; keeps the best.
BundleReport solve_from_several(BundleProblem* problem, const BundleOptions& options) {
  const BundleProblem start = *problem;
  BundleReport best = solve_bundle(problem, options);
  for (size_t camera = 0; camera < start.free_cameras.size(); ++camera) {
    if (std::sqrt(start.free_cameras[camera].covariance(0, 0)) < kWellKnown) continue;
    for (const double factor : kOtherStarts) {
      BundleProblem other = start;
      stretch(camera, factor, &other);
      BundleOptions wide = options;
      wide.rounds = 3;  // the first scale is that of a guess
      const BundleReport report = solve_bundle(&other, wide);
      const double cutoff = best.squared_cutoff;
      if (!report.usable || !(cost_at(other, cutoff) < cost_at(*problem, cutoff))) continue;
      *problem = std::move(other);
      best = report;
    }
  }
  return best;
}

constexpr size_t kClusters = 5;  ///< of keyframes that follow on each other: parts of the motion

using Residuals = std::vector<Eigen::Vector2d>;

/// Whitened; NaN where the point does not project.
Residuals residuals_of(const BundleProblem& problem) {
  Residuals residuals;
  residuals.reserve(problem.observations.size());
  for (const BundleObservation& o : problem.observations) {
    const BundlePose& pose = problem.poses[static_cast<size_t>(o.pose)];
    const auto pixel =
        pose.camera->project(pose.camera_from_map * problem.points[static_cast<size_t>(o.point)]);
    residuals.push_back(pixel ? Eigen::Vector2d((*pixel - o.pixel) * o.inverse_sigma)
                              : Eigen::Vector2d::Constant(NAN));
  }
  return residuals;
}

/// d residual / d intrinsic with all else re-adjusted, by a finite step. False when it could not be solved.
bool total_derivative(const BundleProblem& solved, const Residuals& residuals, size_t camera, int intrinsic,
                      const BundleOptions& options, Residuals* derivative) {
  constexpr double kStep = 0.01;  // of log f, or k1
  BundleProblem moved = solved;
  Intrinsics intrinsics = intrinsics_of(*moved.free_cameras[camera].camera);
  intrinsics[intrinsic] += kStep;
  const CameraPtr held = with_intrinsics(*moved.free_cameras[camera].camera, intrinsics);
  moved.free_cameras.clear();
  for (BundlePose& pose : moved.poses) {
    if (pose.free_camera == static_cast<int>(camera)) pose.camera = held;
    pose.free_camera = -1;
  }
  if (!solve_bundle(&moved, options).usable) return false;
  *derivative = residuals_of(moved);
  for (size_t i = 0; i < residuals.size(); ++i) (*derivative)[i] = ((*derivative)[i] - residuals[i]) / kStep;
  return true;
}

/// Covariance of one camera's intrinsics from the spread of what each keyframe wants of them.
Eigen::Matrix2d cluster_covariance(const BundleProblem& problem, const Residuals& residuals,
                                   const std::array<Residuals, kIntrinsics>& derivatives,
                                   const FreeCamera& camera, double squared_cutoff) {
  const Intrinsics prior_weight =
      noise_variance(squared_cutoff) * camera.prior_sigma.cwiseAbs2().cwiseInverse();
  Eigen::Matrix2d curvature = prior_weight.asDiagonal();
  std::vector<Intrinsics> pulls(kClusters, Intrinsics::Zero());
  for (size_t i = 0; i < residuals.size(); ++i) {
    Eigen::Matrix2d J;
    for (int k = 0; k < kIntrinsics; ++k) J.col(k) = derivatives[static_cast<size_t>(k)][i];
    if (!J.allFinite() || !residuals[i].allFinite()) continue;
    const double weight = tukey_weight(residuals[i].squaredNorm(), squared_cutoff);
    curvature += weight * J.transpose() * J;
    const size_t cluster = static_cast<size_t>(problem.observations[i].pose) * kClusters / problem.poses.size();
    pulls[cluster] += weight * J.transpose() * residuals[i];
  }
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (const Intrinsics& pull : pulls) spread += pull * pull.transpose();
  constexpr auto kUnbiased = static_cast<double>(kClusters) / (kClusters - 1);
  const Eigen::Matrix2d inverse = curvature.inverse();
  return kUnbiased * inverse * spread * inverse;
}

}  // namespace

BundleReport find_cameras(BundleProblem* problem, const BundleOptions& options) {
  std::vector<Eigen::Matrix2d> before;
  for (const FreeCamera& c : problem->free_cameras) before.push_back(c.covariance);
  const BundleReport report = solve_from_several(problem, options);
  if (!report.usable) return report;
  const Residuals residuals = residuals_of(*problem);
  for (size_t c = 0; c < problem->free_cameras.size(); ++c) {
    std::array<Residuals, kIntrinsics> derivatives;
    bool known = true;
    for (int k = 0; k < kIntrinsics; ++k)
      known =
          known && total_derivative(*problem, residuals, c, k, options, &derivatives[static_cast<size_t>(k)]);
    FreeCamera& camera = problem->free_cameras[c];
    const bool was_stopped = options.should_stop && options.should_stop();
    const Eigen::Matrix2d spread =
        known && !was_stopped
            ? cluster_covariance(*problem, residuals, derivatives, camera, report.squared_cutoff)
            : before[c];
    if (spread(0, 0) > camera.covariance(0, 0)) camera.covariance = spread;
  }
  return report;
}

}  // namespace cairn
