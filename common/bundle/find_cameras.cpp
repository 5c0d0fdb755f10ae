// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/find_cameras.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "common/geometry/least_squares.h"
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

constexpr size_t kParts = 5;  ///< of the motion: keyframes that follow on each other

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

/// Tukey's, of each observation.
std::vector<double> weights_of(const Residuals& residuals, double squared_cutoff) {
  std::vector<double> weights;
  weights.reserve(residuals.size());
  for (const Eigen::Vector2d& r : residuals)
    weights.push_back(r.allFinite() ? tukey_weight(r.squaredNorm(), squared_cutoff) : 0);
  return weights;
}

/// The problem with these as the observations' own, to be solved as it is: a cut-off found anew would be
/// another problem's.
BundleProblem with_weights_kept(const BundleProblem& solved, const std::vector<double>& weights) {
  BundleProblem kept = solved;
  kept.free_cameras.clear();
  kept.observations.clear();
  for (size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] <= 0) continue;
    kept.observations.push_back(solved.observations[i]);
    kept.observations.back().inverse_sigma *= std::sqrt(weights[i]);
  }
  return kept;
}

/// How the residuals follow when a camera is another one and poses and points are adjusted to it.
class Follower {
 public:
  Follower(const BundleProblem& solved, const std::vector<double>& weights, const BundleOptions& options)
      : measured_(solved), adjusted_(with_weights_kept(solved, weights)), options_(options) {
    // Far below what a step of a hundredth of the focal length changes, which is little: all else makes up
    // for it.
    options_.function_tolerance = 1e-9;
    options_.max_iterations = 40;
    options_.rounds = 1;
    // Nothing is to be left out; with a larger one the digits of the cost would end before the tolerance.
    options_.min_squared_cutoff = 1e8;
  }

  /// The residuals when `camera` is `other` and poses and points are adjusted to it. Empty when that could
  /// not be solved.
  [[nodiscard]] Residuals residuals_with(size_t camera, const CameraPtr& other) const {
    BundleProblem moved = adjusted_;
    set_camera(&moved, camera, other);
    if (!other || !solve_bundle(&moved, options_).usable) return {};
    BundleProblem measured = measured_;
    measured.poses = std::move(moved.poses);
    measured.points = std::move(moved.points);
    return residuals_of(measured);
  }

 private:
  void set_camera(BundleProblem* problem, size_t camera, const CameraPtr& other) const {
    for (size_t i = 0; i < problem->poses.size(); ++i) {
      problem->poses[i].free_camera = -1;
      if (measured_.poses[i].free_camera == static_cast<int>(camera)) problem->poses[i].camera = other;
    }
  }

  const BundleProblem& measured_;
  BundleProblem adjusted_;
  BundleOptions options_;
};

/// d residual / d one of the values that describe a camera, with poses and points re-adjusted.
Residuals total_derivative(const Follower& follower, const Residuals& residuals, size_t camera,
                           const CameraPtr& other, double step) {
  Residuals derivative = follower.residuals_with(camera, other);
  for (size_t i = 0; i < derivative.size(); ++i) derivative[i] = (derivative[i] - residuals[i]) / step;
  return derivative;
}

/// The derivatives of the residuals by log f and by k1, with poses and points re-adjusted
/// (total_derivative()).
std::array<Residuals, kIntrinsics> intrinsic_derivatives(const Follower& follower, const Residuals& residuals,
                                                         size_t camera, const Camera& now) {
  constexpr double kStep = 0.01;
  std::array<Residuals, kIntrinsics> derivatives;
  for (int k = 0; k < kIntrinsics; ++k) {
    Intrinsics intrinsics = intrinsics_of(now);
    intrinsics[k] += kStep;
    derivatives[static_cast<size_t>(k)] =
        total_derivative(follower, residuals, camera, with_intrinsics(now, intrinsics), kStep);
  }
  return derivatives;
}

/// A value of the camera that is taken for given and is not quite so: its index in the camera's values, and
/// its sigma.
struct TakenForGiven {
  size_t value;
  double sigma;
};
std::array<TakenForGiven, 3> taken_for_given(const Camera& camera) {
  const double off_centre = 0.01 * std::max(camera.width(), camera.height());
  constexpr double kUsualK2 = 0.05;
  return {{{2, off_centre}, {3, off_centre}, {5, kUsualK2}}};
}

/// The derivatives of the residuals by each value of taken_for_given(), in units of its sigma.
std::vector<Residuals> given_derivatives(const Follower& follower, const Residuals& residuals, size_t camera,
                                         const Camera& now) {
  std::vector<Residuals> derivatives;
  for (const TakenForGiven& given : taken_for_given(now)) {
    CameraParameters parameters = now.parameters();
    parameters.values.resize(std::max(parameters.values.size(), given.value + 1), 0.0);
    parameters.values[given.value] += given.sigma;
    derivatives.push_back(
        total_derivative(follower, residuals, camera, make_camera(parameters).value_or(nullptr), 1.0));
  }
  return derivatives;
}

/// What observations say of a camera's intrinsics (log f, k1), by whitened residuals and their total
/// derivatives.
using Evidence = LeastSquares<kIntrinsics>;

/// Jackknife (Tukey 1958): how far the solution would move without each part of the motion, by one step of
/// Gauss and Newton. Unlike the gradients of the parts alone (sandwich) it does not take for agreement that a
/// part which tells most has drawn the solution to itself. `information` is of all parts and the prior.
/// Nothing where the rest does not tell the intrinsics.
std::optional<Eigen::Matrix2d> jackknife(const Eigen::Matrix2d& information,
                                         const std::vector<Evidence>& parts) {
  constexpr double kOfSquares = static_cast<double>(kParts - 1) / kParts;
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  for (const Evidence& part : parts) {
    // At the solution the gradients of all parts make up for each other: the rest has that of `part`,
    // negative.
    const Evidence rest{information - part.information, -part.gradient};
    const auto move = rest.step();
    if (!move) return std::nullopt;
    sum += kOfSquares * *move * move->transpose();
  }
  return sum;
}

/// The part of the motion that each pose belongs to: as many poses of the camera to each; others go with the
/// one before them.
std::vector<size_t> parts_of_poses(const BundleProblem& problem, size_t camera) {
  const auto is_own = [&](const BundlePose& p) { return p.free_camera == static_cast<int>(camera); };
  const auto own = static_cast<size_t>(std::count_if(problem.poses.begin(), problem.poses.end(), is_own));
  std::vector<size_t> parts;
  size_t before = 0;
  for (const BundlePose& pose : problem.poses) {
    before += is_own(pose) ? 1 : 0;
    parts.push_back(before == 0 ? 0 : (before - 1) * kParts / own);
  }
  return parts;
}

/// Covariance of one camera's intrinsics: the formal one, the spread of what the parts of the motion want of
/// them, and what the values taken for given may have done. Nothing where they are not told.
std::optional<Eigen::Matrix2d> honest_covariance(const BundleProblem& problem, size_t camera,
                                                 const Residuals& residuals,
                                                 const std::vector<double>& weights,
                                                 const std::array<Residuals, kIntrinsics>& derivatives,
                                                 const std::vector<Residuals>& by_given,
                                                 double squared_cutoff) {
  const FreeCamera& judged = problem.free_cameras[camera];
  Eigen::Matrix2d information =
      prior_pull(judged, *judged.camera, squared_cutoff).curvature.asDiagonal().toDenseMatrix();
  const std::vector<size_t> part_of = parts_of_poses(problem, camera);
  std::vector<Evidence> parts(kParts);
  std::vector<Evidence> of_given(by_given.size());
  for (size_t i = 0; i < residuals.size(); ++i) {
    Eigen::Matrix2d J;
    for (int k = 0; k < kIntrinsics; ++k) J.col(k) = derivatives[static_cast<size_t>(k)][i];
    if (weights[i] <= 0 || !J.allFinite() || !residuals[i].allFinite()) continue;
    parts[part_of[static_cast<size_t>(problem.observations[i].pose)]].add(J, residuals[i], weights[i]);
    for (size_t g = 0; g < by_given.size(); ++g) {
      if (by_given[g][i].allFinite()) of_given[g].add(J, by_given[g][i], weights[i]);
    }
  }
  for (const Evidence& part : parts) information += part.information;
  const auto spread = jackknife(information, parts);
  if (!spread) return std::nullopt;
  Eigen::Matrix2d covariance = judged.covariance + *spread;
  for (const Evidence& given : of_given) {
    const auto move = Evidence{information, given.gradient}.step();
    if (!move) return std::nullopt;
    covariance += *move * move->transpose();
  }
  return covariance;
}

/// The honest_covariance() of a free camera. Nothing where there is none: a problem that could not be solved,
/// observations that do not tell the intrinsics, or no more time.
std::optional<Eigen::Matrix2d> judge(const BundleProblem& problem, size_t camera, double squared_cutoff,
                                     const BundleOptions& options) {
  const FreeCamera& judged = problem.free_cameras[camera];
  const std::vector<double> weights = weights_of(residuals_of(problem), squared_cutoff);
  const Follower follower(problem, weights, options);
  const Residuals residuals = follower.residuals_with(camera, judged.camera);
  if (residuals.empty()) return std::nullopt;
  const auto derivatives = intrinsic_derivatives(follower, residuals, camera, *judged.camera);
  const auto by_given = given_derivatives(follower, residuals, camera, *judged.camera);
  const auto is_there = [](const Residuals& d) { return !d.empty(); };
  const bool known = std::all_of(derivatives.begin(), derivatives.end(), is_there) &&
                     std::all_of(by_given.begin(), by_given.end(), is_there);
  const bool was_stopped = options.should_stop && options.should_stop();
  if (!known || was_stopped) return std::nullopt;
  return honest_covariance(problem, camera, residuals, weights, derivatives, by_given, squared_cutoff);
}

}  // namespace

BundleReport find_cameras(BundleProblem* problem, const BundleOptions& options) {
  std::vector<Eigen::Matrix2d> before;
  for (const FreeCamera& c : problem->free_cameras) before.push_back(c.covariance);
  BundleReport report = solve_from_several(problem, options);
  if (!report.usable) return report;
  for (size_t c = 0; c < problem->free_cameras.size(); ++c) {
    FreeCamera& camera = problem->free_cameras[c];
    const auto judged =
        camera.judge ? judge(*problem, c, report.squared_cutoff, options) : std::optional<Eigen::Matrix2d>();
    camera.covariance = judged.value_or(before[c]);
    // Stopped in the middle of it: the adjustment is not through.
    if (camera.judge && !judged && options.should_stop && options.should_stop()) report.converged = false;
    camera.judge = judged.has_value();
  }
  return report;
}

}  // namespace cairn
