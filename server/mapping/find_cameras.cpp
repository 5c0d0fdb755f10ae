// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/find_cameras.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr double kWellKnown = 0.03;  ///< sigma of log f below which one start is enough
constexpr std::array<double, 5> kOtherStarts{0.6, 0.8, 1.0, 1.25, 1.6};  ///< factors on the focal length

/// Another focal length for one camera, its distortion as the prior has it, and what an affine camera could
/// not tell from before: depth along the first camera's axis stretched by the same factor, turns of the
/// camera shrunk by it (the bas-relief ambiguity). False where they make no camera.
bool stretch(size_t camera, double factor, BundleProblem* problem) {
  FreeCamera& free_camera = problem->free_cameras[camera];
  Intrinsics intrinsics = intrinsics_of(*free_camera.camera);
  intrinsics[0] += std::log(factor);
  intrinsics[1] = free_camera.prior_mean[1];
  CameraPtr other = with_intrinsics(*free_camera.camera, within_reach(free_camera, intrinsics));
  if (!other) return false;
  free_camera.camera = std::move(other);
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
  return true;
}

double cost_at(const BundleProblem& problem, double squared_cutoff) {
  double sum = 0;
  for (const FreeCamera& c : problem.free_cameras) sum += prior_cost(c, *c.camera, squared_cutoff);
  for (const double s : squared_residuals(problem)) sum += tukey_cost(s, squared_cutoff);
  return sum;
}

/// Whether it may lie in a wrong valley: focal length and distortion make up for each other over a few views
/// of a plane, up to where the prior ends.
bool may_be_wrong(const FreeCamera& camera) {
  if (camera.prior_sigma[0] < kWellKnown) return false;
  return std::sqrt(camera.covariance(0, 0)) >= kWellKnown || is_held_by_prior(camera);
}

/// Solves from other focal lengths too; keeps the best.
BundleReport solve_from_several(BundleProblem* problem, const BundleOptions& options) {
  const BundleProblem start = *problem;
  BundleReport best = solve_bundle(problem, options);
  for (size_t camera = 0; camera < start.free_cameras.size(); ++camera) {
    const FreeCamera& before = start.free_cameras[camera];
    if (!before.judge || !may_be_wrong(before)) continue;
    for (const double factor : kOtherStarts) {
      BundleProblem other = start;
      if (!stretch(camera, factor, &other)) continue;
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

/// d residual / d one of the values that describe a camera, with poses and points re-adjusted, by a finite
/// step to another camera. Empty when that could not be solved.
Residuals total_derivative(const BundleProblem& solved, const Residuals& residuals, size_t camera,
                           const CameraPtr& other, double step, const BundleOptions& options) {
  BundleProblem moved = solved;
  moved.free_cameras.clear();
  for (BundlePose& pose : moved.poses) {
    if (pose.free_camera == static_cast<int>(camera)) pose.camera = other;
    pose.free_camera = -1;
  }
  if (!other || !solve_bundle(&moved, options).usable) return {};
  Residuals derivative = residuals_of(moved);
  for (size_t i = 0; i < residuals.size(); ++i) derivative[i] = (derivative[i] - residuals[i]) / step;
  return derivative;
}

/// By log f and k1.
std::array<Residuals, kIntrinsics> intrinsic_derivatives(const BundleProblem& solved,
                                                         const Residuals& residuals, size_t camera,
                                                         const BundleOptions& options) {
  constexpr double kStep = 0.01;
  std::array<Residuals, kIntrinsics> derivatives;
  const Camera& now = *solved.free_cameras[camera].camera;
  for (int k = 0; k < kIntrinsics; ++k) {
    Intrinsics intrinsics = intrinsics_of(now);
    intrinsics[k] += kStep;
    derivatives[static_cast<size_t>(k)] =
        total_derivative(solved, residuals, camera, with_intrinsics(now, intrinsics), kStep, options);
  }
  return derivatives;
}

/// What is taken for given and is not quite so: index in the camera's values, and sigma.
struct TakenForGiven {
  size_t value;
  double sigma;
};
std::array<TakenForGiven, 3> taken_for_given(const Camera& camera) {
  const double off_centre = 0.01 * std::max(camera.width(), camera.height());
  constexpr double kUsualK2 = 0.05;
  return {{{2, off_centre}, {3, off_centre}, {5, kUsualK2}}};
}

/// By each of them, in units of its sigma.
std::vector<Residuals> given_derivatives(const BundleProblem& solved, const Residuals& residuals,
                                         size_t camera, const BundleOptions& options) {
  std::vector<Residuals> derivatives;
  const Camera& now = *solved.free_cameras[camera].camera;
  for (const TakenForGiven& given : taken_for_given(now)) {
    CameraParameters parameters = now.parameters();
    parameters.values.resize(std::max(parameters.values.size(), given.value + 1), 0.0);
    parameters.values[given.value] += given.sigma;
    derivatives.push_back(
        total_derivative(solved, residuals, camera, make_camera(parameters).value_or(nullptr), 1.0, options));
  }
  return derivatives;
}

/// Covariance of one camera's intrinsics: the spread of what the parts of the motion want of them, or the
/// formal one where that is larger, and what the values taken for given may have done.
Eigen::Matrix2d honest_covariance(const BundleProblem& problem, const Residuals& residuals,
                                  const std::array<Residuals, kIntrinsics>& derivatives,
                                  const std::vector<Residuals>& by_given, const FreeCamera& camera,
                                  double squared_cutoff) {
  Eigen::Matrix2d curvature =
      prior_pull(camera, *camera.camera, squared_cutoff).curvature.asDiagonal().toDenseMatrix();
  std::vector<Intrinsics> pulls(kClusters, Intrinsics::Zero());
  std::vector<Intrinsics> pulls_of_given(by_given.size(), Intrinsics::Zero());
  for (size_t i = 0; i < residuals.size(); ++i) {
    Eigen::Matrix2d J;
    for (int k = 0; k < kIntrinsics; ++k) J.col(k) = derivatives[static_cast<size_t>(k)][i];
    if (!J.allFinite() || !residuals[i].allFinite()) continue;
    const double weight = tukey_weight(residuals[i].squaredNorm(), squared_cutoff);
    curvature += weight * J.transpose() * J;
    const size_t cluster =
        static_cast<size_t>(problem.observations[i].pose) * kClusters / problem.poses.size();
    pulls[cluster] += weight * J.transpose() * residuals[i];
    for (size_t g = 0; g < by_given.size(); ++g) {
      if (by_given[g][i].allFinite()) pulls_of_given[g] += weight * J.transpose() * by_given[g][i];
    }
  }
  const auto sum_of_squares = [](const std::vector<Intrinsics>& all) {
    Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
    for (const Intrinsics& pull : all) sum += pull * pull.transpose();
    return sum;
  };
  constexpr double kUnbiased = static_cast<double>(kClusters) / (kClusters - 1);
  const Eigen::Matrix2d inverse = curvature.inverse();
  const Eigen::Matrix2d spread = kUnbiased * inverse * sum_of_squares(pulls) * inverse;
  const Eigen::Matrix2d given = inverse * sum_of_squares(pulls_of_given) * inverse;
  return (spread(0, 0) > camera.covariance(0, 0) ? spread : camera.covariance) + given;
}

/// Nothing when it could not be judged: a problem that could not be solved, or no more time.
std::optional<Eigen::Matrix2d> judge(const BundleProblem& problem, const Residuals& residuals, size_t camera,
                                     double squared_cutoff, const BundleOptions& options) {
  const auto derivatives = intrinsic_derivatives(problem, residuals, camera, options);
  const auto by_given = given_derivatives(problem, residuals, camera, options);
  const auto is_there = [](const Residuals& d) { return !d.empty(); };
  const bool known = std::all_of(derivatives.begin(), derivatives.end(), is_there) &&
                     std::all_of(by_given.begin(), by_given.end(), is_there);
  const bool was_stopped = options.should_stop && options.should_stop();
  if (!known || was_stopped) return std::nullopt;
  return honest_covariance(problem, residuals, derivatives, by_given, problem.free_cameras[camera],
                           squared_cutoff);
}

}  // namespace

BundleReport find_cameras(BundleProblem* problem, const BundleOptions& options) {
  std::vector<Eigen::Matrix2d> before;
  for (const FreeCamera& c : problem->free_cameras) before.push_back(c.covariance);
  const BundleReport report = solve_from_several(problem, options);
  if (!report.usable) return report;
  const Residuals residuals = residuals_of(*problem);
  for (size_t c = 0; c < problem->free_cameras.size(); ++c) {
    FreeCamera& camera = problem->free_cameras[c];
    const auto judged = camera.judge ? judge(*problem, residuals, c, report.squared_cutoff, options)
                                     : std::optional<Eigen::Matrix2d>();
    camera.covariance = judged.value_or(before[c]);
    camera.judge = judged.has_value();
  }
  return report;
}

}  // namespace cairn
