// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/pose.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "common/geometry/normal_equations.h"
#include "common/geometry/ransac.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr size_t kMinObservations = 4;

/// Standard deviation of an inverse depth over its value up to which it says where the camera is. Beyond, the
/// prior would decide, and in that a wall that is farther than expected is wrong for all its corners alike.
constexpr double kKnownDepth = 0.2;

using Linearized = PoseWorkspace::Linearized;

void linearize(const Camera& camera, const SE3& camera_from_map,
               std::span<const PointObservation> observations, std::vector<Linearized>& out) {
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  const Eigen::Vector3d& translation = camera_from_map.translation();
  for (size_t i = 0; i < observations.size(); ++i) {
    const PointObservation& observation = observations[i];
    Linearized& o = out[i];
    const Eigen::Vector3d p = rotation * observation.point_in_map + translation;
    Matrix23d d_pixel_d_point;
    const auto pixel = camera.project(p, &d_pixel_d_point);
    o.in_view = pixel.has_value();
    if (!o.in_view) continue;
    const double whitening = 1.0 / observation.sigma;
    o.residual = whitening * (*pixel - observation.pixel).array();
    o.squared = o.residual.square().sum();
    const Eigen::Array2d ax = whitening * d_pixel_d_point.col(0).array();
    const Eigen::Array2d ay = whitening * d_pixel_d_point.col(1).array();
    const Eigen::Array2d az = whitening * d_pixel_d_point.col(2).array();
    // The rows a^T (-[p]x) = (p x a)^T.
    o.d_residual_d_xi = {
        ax, ay, az, p.y() * az - p.z() * ay, p.z() * ax - p.x() * az, p.x() * ay - p.y() * ax};
  }
}

/// Each row mixes x and y: the noise, in which the distance is marginalised, lies across the axes.
void linearize(const Camera& camera, const SE3& camera_from_map, std::span<const BearingObservation> bearings,
               std::span<Linearized> out) {
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  const Eigen::Vector3d& translation = camera_from_map.translation();
  for (size_t i = 0; i < bearings.size(); ++i) {
    const BearingObservation& b = bearings[i];
    Linearized& o = out[i];
    // The point times its inverse depth: cameras know directions only.
    const Eigen::Vector3d origin = rotation * b.origin_in_map + translation;
    const Eigen::Vector3d p = rotation * b.bearing_in_map + b.inverse_depth * origin;
    Matrix23d d_pixel_d_p;
    const auto pixel = camera.project(p, &d_pixel_d_p);
    o.in_view = pixel.has_value();
    if (!o.in_view) continue;
    const Eigen::Vector2d d_pixel_d_depth = d_pixel_d_p * origin;
    const Eigen::Matrix2d noise = b.sigma * b.sigma * Eigen::Matrix2d::Identity() +
                                  b.inverse_depth_variance * d_pixel_d_depth * d_pixel_d_depth.transpose();
    // The inverse of its Cholesky factor.
    const double l00 = std::sqrt(noise(0, 0));
    const double l10 = noise(1, 0) / l00;
    const double l11 = std::sqrt(noise(1, 1) - l10 * l10);
    const auto whitened = [&](const Eigen::Vector2d& v) -> Eigen::Array2d {
      const double x = v.x() / l00;
      return {x, (v.y() - l10 * x) / l11};
    };
    o.residual = whitened(*pixel - b.pixel);
    o.squared = o.residual.square().sum();
    const Eigen::Array2d ax = whitened(d_pixel_d_p.col(0));
    const Eigen::Array2d ay = whitened(d_pixel_d_p.col(1));
    const Eigen::Array2d az = whitened(d_pixel_d_p.col(2));
    const double limit = kKnownDepth * b.inverse_depth;
    const double moves = b.inverse_depth_variance <= limit * limit ? b.inverse_depth : 0.0;
    o.d_residual_d_xi = {moves * ax,
                         moves * ay,
                         moves * az,
                         p.y() * az - p.z() * ay,
                         p.z() * ax - p.x() * az,
                         p.x() * ay - p.y() * ax};
  }
}

void linearize(const Camera& camera, const SE3& pose, std::span<const PointObservation> observations,
               std::span<const BearingObservation> bearings, std::vector<Linearized>& out) {
  linearize(camera, pose, observations, out);
  if (!bearings.empty())
    linearize(camera, pose, bearings, std::span(out).subspan(observations.size(), bearings.size()));
}

/// What a prior adds to the normal equations at a pose. A step to the left moves the centre by its
/// translation, turned back: centre' = centre - R^T v.
void add_prior(const PositionPrior& prior, const SE3& pose, Matrix6d* information, Vector6d* gradient) {
  const double weight = 1.0 / (prior.sigma * prior.sigma);
  information->topLeftCorner<3, 3>().diagonal().array() += weight;
  gradient->head<3>() -= weight * (pose.rotation() * (pose.center() - prior.center_in_map));
}

/// Tukey's cut-off for an iteration: from the median of what is in view, never below the floor.
double cutoff_for(int iteration, const PoseOptions& options, PoseWorkspace* workspace) {
  if (iteration >= options.fixed_cutoff_after) return options.late_squared_cutoff;
  std::vector<double>& squared = workspace->squared;
  squared.clear();
  for (const auto& o : workspace->linearized) {
    if (o.in_view) squared.push_back(o.squared);
  }
  return std::clamp(tukey_squared_cutoff(squared), options.min_squared_cutoff, options.max_squared_cutoff);
}

void weigh(std::span<const Linearized> linearized, double cutoff, std::vector<double>* weights) {
  weights->resize(linearized.size());
  for (size_t i = 0; i < linearized.size(); ++i) {
    const Linearized& o = linearized[i];
    (*weights)[i] = o.in_view ? tukey_weight(o.squared, cutoff) : 0.0;
  }
}

/// Cholesky of a matrix that must be safely positive definite: nothing if a direction of the pose is not
/// determined.
std::optional<Eigen::LDLT<Matrix6d>> factorize(const Matrix6d& m) {
  Eigen::LDLT<Matrix6d> ldlt(m);
  const Vector6d d = ldlt.vectorD();
  if (ldlt.info() != Eigen::Success || !d.allFinite() || !(d.minCoeff() > 1e-13 * d.maxCoeff()))
    return std::nullopt;
  return ldlt;
}

tl::unexpected<Error> singular() {
  return fail(ErrorCode::kDegenerate, "pose: the observations do not determine it");
}

/// Weights, inliers, rms, information and covariance (for the sigmas as given, without options.prior) at the
/// end.
Status summarize(const SE3& pose, const std::vector<Linearized>& linearized, double cutoff,
                 const std::optional<PositionPrior>& position, PoseEstimate* estimate) {
  estimate->camera_from_map = pose;
  weigh(linearized, cutoff, &estimate->weights);
  estimate->inliers = 0;
  double total_weight = 0;
  double total_squared = 0;
  for (size_t i = 0; i < linearized.size(); ++i) {
    const double weight = estimate->weights[i];
    if (!(weight > 0)) continue;
    ++estimate->inliers;
    total_weight += weight;
    total_squared += weight * linearized[i].squared;
  }
  estimate->information = sum_up(linearized, estimate->weights).information();
  Matrix6d information = estimate->information;
  Vector6d gradient = Vector6d::Zero();
  if (position) add_prior(*position, pose, &information, &gradient);
  const auto factor = factorize(information);
  if (!factor || static_cast<size_t>(estimate->inliers) < kMinObservations) return singular();
  estimate->rms = std::sqrt(total_squared / total_weight);
  estimate->covariance = factor->solve(Matrix6d::Identity());
  return {};
}

/// Rays of the pixels that are drawn, each undistorted once, however often it is drawn.
class DrawnRays {
 public:
  DrawnRays(const Camera& camera, std::span<const PointObservation> observations)
      : camera_(camera), observations_(observations), rays_(observations.size()) {}
  const Eigen::Vector3d& at(size_t i) {
    std::optional<Eigen::Vector3d>& ray = rays_[i];
    if (!ray) ray = camera_.unproject(observations_[i].pixel);
    return *ray;
  }

 private:
  const Camera& camera_;
  std::span<const PointObservation> observations_;
  std::vector<std::optional<Eigen::Vector3d>> rays_;
};

/// Truncated squared error (MSAC) of a pose; gives up once it exceeds `limit`.
double msac_cost(const Camera& camera, const SE3& pose, std::span<const PointObservation> observations,
                 double squared_threshold, double limit) {
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  return truncated_cost(observations, squared_threshold, limit, [&](const PointObservation& o) {
    const auto pixel = camera.project(Eigen::Vector3d(rotation * o.point_in_map + pose.translation()));
    return pixel ? (*pixel - o.pixel).squaredNorm() / (o.sigma * o.sigma) : squared_threshold;
  });
}

/// The best pose that three observations allow, if it costs less than `limit`.
std::optional<Hypothesis<SE3>> pose_of_triple(const Camera& camera,
                                              std::span<const PointObservation> observations,
                                              const std::array<size_t, 3>& sample, double squared_threshold,
                                              double limit, DrawnRays* drawn) {
  std::array<Eigen::Vector3d, 3> rays;
  std::array<Eigen::Vector3d, 3> points;
  for (size_t i = 0; i < 3; ++i) {
    rays[i] = drawn->at(sample[i]);
    points[i] = observations[sample[i]].point_in_map;
  }
  std::optional<Hypothesis<SE3>> best;
  for (const SE3& pose : solve_p3p(rays, points)) {
    const double least = best ? best->cost : limit;
    const double cost = msac_cost(camera, pose, observations, squared_threshold, least);
    if (cost < least) best = {pose, cost};
  }
  return best;
}

}  // namespace

Result<PoseEstimate> optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                                   std::span<const PointObservation> observations,
                                   const PoseOptions& options) {
  PoseWorkspace workspace;
  PoseEstimate estimate;
  return optimize_pose(camera, camera_from_map_start, observations, options, &workspace, &estimate).map([&] {
    return std::move(estimate);
  });
}

Status optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                     std::span<const PointObservation> observations, const PoseOptions& options,
                     PoseWorkspace* workspace, PoseEstimate* estimate) {
  return optimize_pose(camera, camera_from_map_start, observations, {}, options, workspace, estimate);
}

Status optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                     std::span<const PointObservation> observations, const PoseSupplement& supplement,
                     const PoseOptions& options, PoseWorkspace* workspace, PoseEstimate* estimate) {
  const size_t count = observations.size() + supplement.bearings.size();
  if (count < kMinObservations) {
    return fail(ErrorCode::kDegenerate, "pose: fewer than 4 observations");
  }
  // Squared step, in standard deviations of the pose as the sigmas have it: what is left is a hundredth of
  // what the noise of the best measurements leaves open.
  constexpr double kConverged = 1e-6;
  std::vector<Linearized>& linearized = workspace->linearized;
  linearized.resize(count);
  workspace->squared.reserve(count);
  SE3 pose = camera_from_map_start;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    linearize(camera, pose, observations, supplement.bearings, linearized);
    weigh(linearized, cutoff_for(iteration, options, workspace), &estimate->weights);
    const NormalEquations sum = sum_up(linearized, estimate->weights);
    Matrix6d information = sum.information() + options.prior * Matrix6d::Identity();
    Vector6d gradient = sum.gradient();
    if (supplement.position) add_prior(*supplement.position, pose, &information, &gradient);
    const auto factor = factorize(information);
    if (!factor) return singular();
    // The update of the pose: PTAM 2007, eq. 6 and 8. The residual is that of eq. 9 with the other sign:
    // projected - measured.
    const Vector6d step = -factor->solve(gradient);
    pose = SE3::exp(step) * pose;
    if (!pose.is_finite()) return singular();
    // While a switch of the cut-off is still to come, a small step does not mean the end.
    const bool cutoff_settled =
        options.fixed_cutoff_after >= options.iterations || iteration >= options.fixed_cutoff_after;
    if (cutoff_settled && -step.dot(gradient) < kConverged) break;
  }
  linearize(camera, pose, observations, supplement.bearings, linearized);
  return summarize(pose, linearized, cutoff_for(options.iterations, options, workspace), supplement.position,
                   estimate);
}

Result<PoseEstimate> ransac_pose(const Camera& camera, std::span<const PointObservation> observations,
                                 const PoseRansacOptions& options) {
  if (observations.size() <
      std::max<size_t>(kMinObservations, static_cast<size_t>(std::max(options.min_inliers, 0)))) {
    return fail(ErrorCode::kDegenerate, "pose: " + std::to_string(observations.size()) +
                                            " matches, at least " + std::to_string(options.min_inliers) +
                                            " needed");
  }
  const double squared_threshold = options.threshold * options.threshold;
  RansacOptions drawing;
  drawing.population = observations.size();
  drawing.all_outliers = squared_threshold * static_cast<double>(observations.size());
  drawing.most_trials = options.iterations;
  drawing.seed = options.seed;
  DrawnRays drawn(camera, observations);
  const auto best = ransac<3, SE3>(drawing, [&](const std::array<size_t, 3>& sample, double limit) {
    return pose_of_triple(camera, observations, sample, squared_threshold, limit, &drawn);
  });
  if (!best) return fail(ErrorCode::kDegenerate, "pose: no triple of matches gives a pose");

  // Tukey's cut-off is fixed at the RANSAC threshold: with outliers in the majority the median would be
  // theirs.
  PoseOptions refinement;
  refinement.fixed_cutoff_after = 0;
  refinement.late_squared_cutoff = squared_threshold;
  auto estimate = optimize_pose(camera, *best, observations, refinement);
  if (estimate && estimate->inliers < options.min_inliers) {
    return fail(ErrorCode::kDegenerate, "pose: " + std::to_string(estimate->inliers) + " inliers, at least " +
                                            std::to_string(options.min_inliers) + " needed");
  }
  return estimate;
}

}  // namespace cairn
