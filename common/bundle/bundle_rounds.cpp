// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/bundle_rounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr int kScaleRoundIterations = 2;

double robust_squared_cutoff(std::vector<double> squared_residuals, double floor) {
  return std::max(floor, tukey_squared_cutoff(squared_residuals));
}

double robust_cost(const std::vector<double>& squared_residuals, const std::vector<FreeCamera>& cameras,
                   double squared_cutoff) {
  double sum = 0;
  for (const FreeCamera& c : cameras) sum += prior_cost(c, *c.camera, squared_cutoff);
  for (const double s : squared_residuals) sum += tukey_cost(s, squared_cutoff);
  return sum;
}

bool is_finite(const BundleProblem& problem) {
  return std::all_of(problem.poses.begin(), problem.poses.end(),
                     [](const BundlePose& p) { return p.camera_from_map.is_finite(); }) &&
         std::all_of(problem.points.begin(), problem.points.end(),
                     [](const Eigen::Vector3d& p) { return p.allFinite(); });
}

double squared_residual(const BundlePose& pose, const Eigen::Vector3d& in_camera,
                        const BundleObservation& o) {
  const auto pixel = pose.camera->project(in_camera);
  if (!pixel) return std::numeric_limits<double>::infinity();
  return (*pixel - o.pixel).squaredNorm() * o.inverse_sigma * o.inverse_sigma;
}

}  // namespace

double squared_residual(const BundleProblem& problem, const BundleObservation& o) {
  const BundlePose& pose = problem.poses[static_cast<size_t>(o.pose)];
  return squared_residual(pose, pose.camera_from_map * problem.points[static_cast<size_t>(o.point)], o);
}

std::vector<double> squared_residuals(const BundleProblem& problem) {
  std::vector<Eigen::Matrix3d> rotations;
  rotations.reserve(problem.poses.size());
  for (const BundlePose& p : problem.poses) rotations.push_back(p.camera_from_map.rotation_matrix());
  std::vector<double> result;
  result.reserve(problem.observations.size());
  for (const BundleObservation& o : problem.observations) {
    const auto pose = static_cast<size_t>(o.pose);
    const Eigen::Vector3d in_camera = rotations[pose] * problem.points[static_cast<size_t>(o.point)] +
                                      problem.poses[pose].camera_from_map.translation();
    result.push_back(squared_residual(problem.poses[pose], in_camera, o));
  }
  return result;
}

BundleReport solve_in_rounds(BundleProblem* problem, const BundleOptions& options,
                             const Minimization& minimize) {
  BundleReport report;
  report.observations = static_cast<int>(problem->observations.size());
  if (problem->observations.empty()) return report;
  const std::vector<BundlePose> poses_before = problem->poses;
  const std::vector<Eigen::Vector3d> points_before = problem->points;
  const std::vector<FreeCamera> cameras_before = problem->free_cameras;
  const std::vector<double> residuals_before = squared_residuals(*problem);
  for (int round = 0; round < options.rounds; ++round) {
    report.squared_cutoff = robust_squared_cutoff(round == 0 ? residuals_before : squared_residuals(*problem),
                                                  options.min_squared_cutoff);
    const bool last = round + 1 == options.rounds;
    const MinimizationReport done =
        minimize(report.squared_cutoff, last ? options.max_iterations : kScaleRoundIterations);
    report.iterations += done.iterations;
    report.converged = done.converged && last;
    if (!done.usable || done.stopped) break;
  }
  report.initial_cost = robust_cost(residuals_before, cameras_before, report.squared_cutoff);
  report.final_cost = is_finite(*problem) ? robust_cost(squared_residuals(*problem), problem->free_cameras,
                                                        report.squared_cutoff)
                                          : std::numeric_limits<double>::infinity();
  report.usable = std::isfinite(report.final_cost) && report.final_cost <= report.initial_cost * (1 + 1e-9);
  if (!report.usable) {
    problem->poses = poses_before;
    problem->points = points_before;
    problem->free_cameras = cameras_before;
  }
  return report;
}

}  // namespace cairn
