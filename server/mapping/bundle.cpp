// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/bundle.h"

#include <ceres/ceres.h>

#include <array>
#include <cmath>
#include <deque>
#include <limits>

#include "common/geometry/robust.h"
#include "server/mapping/bundle_ceres.h"

namespace cairn {
namespace {

constexpr double kHugeResidual = 1e6;
constexpr int kScaleRoundIterations = 2;

/// Above this many moving poses the reduced camera matrix of a map is sparse enough for CHOLMOD to beat a
/// dense factorisation.
constexpr int kDenseSchurPoses = 150;

using PoseParameters = std::array<double, kPoseParameters>;

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const std::function<bool()>* should_stop) : should_stop_(should_stop) {}
  // ABORT would put the parameters back (flann-ceres.md).
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    if (!*should_stop_ || !(*should_stop_)()) return ceres::SOLVER_CONTINUE;
    stopped_ = true;
    return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }
  [[nodiscard]] bool stopped() const { return stopped_; }

 private:
  const std::function<bool()>* should_stop_;
  bool stopped_ = false;
};

/// The Ceres problem over copies of the poses (points are adjusted where they are).
class CeresBundle {
 public:
  explicit CeresBundle(BundleProblem* problem) : problem_(problem), ceres_(make_options()) {
    poses_.resize(problem->poses.size());

    for (size_t i = 0; i < poses_.size(); ++i) {
      pose_to_parameters(problem->poses[i].camera_from_map, poses_[i].data());
    }
    for (const BundleObservation& o : problem->observations) {
      const auto pose = static_cast<size_t>(o.pose);
      costs_.emplace_back(problem->poses[pose].camera.get(), o.pixel, o.inverse_sigma);
      ceres_.AddResidualBlock(&costs_.back(), &loss_, poses_[pose].data(),
                              problem->points[static_cast<size_t>(o.point)].data());
    }
    set_ordering();
  }

  ceres::Solver::Summary solve(double squared_cutoff, const BundleOptions& options, int max_iterations,
                               StopCallback* callback) {
    loss_.Reset(new ceres::TukeyLoss(std::sqrt(squared_cutoff)), ceres::TAKE_OWNERSHIP);
    ceres::Solver::Options o;
    o.linear_solver_ordering = ordering_;
    o.linear_solver_type = moving_poses_ <= kDenseSchurPoses ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
    o.max_num_iterations = max_iterations;
    o.function_tolerance = options.function_tolerance;
    o.num_threads = options.threads;
    o.jacobi_scaling = true;
    // With one fixed pose the scale is free: without some damping the reduced system is singular.
    o.max_trust_region_radius = 1e8;
    o.logging_type = ceres::SILENT;
    o.callbacks.push_back(callback);
    ceres::Solver::Summary summary;
    ceres::Solve(o, &ceres_, &summary);
    return summary;
  }

  void write_poses() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!problem_->poses[i].fixed)
        problem_->poses[i].camera_from_map = pose_from_parameters(poses_[i].data());
    }
  }

 private:
  static ceres::Problem::Options make_options() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  void set_ordering() {
    ordering_ = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Eigen::Vector3d& point : problem_->points) {
      if (ceres_.HasParameterBlock(point.data())) ordering_->AddElementToGroup(point.data(), 0);
    }
    for (size_t i = 0; i < poses_.size(); ++i) {
      double* pose = poses_[i].data();
      if (!ceres_.HasParameterBlock(pose)) continue;
      ceres_.SetManifold(pose, &manifold_);
      ordering_->AddElementToGroup(pose, 1);
      if (problem_->poses[i].fixed) {
        ceres_.SetParameterBlockConstant(pose);
      } else {
        ++moving_poses_;
      }
    }
  }

  BundleProblem* problem_;
  PoseManifold manifold_;
  ceres::LossFunctionWrapper loss_{nullptr, ceres::TAKE_OWNERSHIP};
  std::vector<PoseParameters> poses_;
  std::deque<ReprojectionCost> costs_;  // Ceres keeps addresses
  ceres::Problem ceres_;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_;
  int moving_poses_ = 0;
};

double robust_squared_cutoff(const BundleProblem& problem, double floor) {
  std::vector<double> errors;
  errors.reserve(problem.observations.size());
  for (const BundleObservation& o : problem.observations) errors.push_back(squared_residual(problem, o));
  return std::max(floor, tukey_squared_cutoff(errors));
}

double robust_cost(const BundleProblem& problem, double squared_cutoff) {
  double sum = 0;
  for (const BundleObservation& o : problem.observations) {
    sum += tukey_cost(squared_residual(problem, o), squared_cutoff);
  }
  return sum;
}

bool is_finite(const BundleProblem& problem) {
  for (const BundlePose& p : problem.poses) {
    if (!p.camera_from_map.is_finite()) return false;
  }
  for (const Eigen::Vector3d& p : problem.points) {
    if (!p.allFinite()) return false;
  }
  return true;
}

}  // namespace

void pose_to_parameters(const SE3& camera_from_map, double* parameters) {
  Eigen::Map<Eigen::Vector3d>{parameters} = camera_from_map.translation();
  Eigen::Map<Eigen::Vector4d>{parameters + 3} = camera_from_map.rotation().coeffs();
}

SE3 pose_from_parameters(const double* parameters) {
  return {Eigen::Quaterniond(parameters + 3), Eigen::Vector3d(parameters)};
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  pose_to_parameters(SE3::exp(Eigen::Map<const Vector6d>(delta)) * pose_from_parameters(x), x_plus_delta);
  return true;
}

bool PoseManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kPoseParameters, 6, Eigen::RowMajor>>{jacobian}.setIdentity();
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector6d>{y_minus_x} = (pose_from_parameters(y) * pose_from_parameters(x).inverse()).log();
  return true;
}

bool PoseManifold::MinusJacobian(const double* /*x*/, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 6, kPoseParameters, Eigen::RowMajor>>{jacobian}.setIdentity();
  return true;
}

bool ReprojectionCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const Eigen::Map<const Eigen::Quaterniond> rotation(parameters[0] + 3);
  const Eigen::Matrix3d R = rotation.toRotationMatrix();
  const Eigen::Vector3d in_camera =
      R * Eigen::Map<const Eigen::Vector3d>(parameters[1]) + Eigen::Map<const Eigen::Vector3d>(parameters[0]);
  Matrix23d d_pixel;
  const auto pixel = jacobians ? camera_->project(in_camera, &d_pixel) : camera_->project(in_camera);
  Eigen::Map<Eigen::Vector2d> residual(residuals);
  if (!pixel) {
    residual.setConstant(kHugeResidual);
    d_pixel.setZero();
  } else {
    residual = inverse_sigma_ * (*pixel - pixel_);
    d_pixel *= inverse_sigma_;
  }
  if (!jacobians) return true;
  if (jacobians[0]) {
    Eigen::Map<Eigen::Matrix<double, 2, kPoseParameters, Eigen::RowMajor>> J(jacobians[0]);
    J.leftCols<3>() = d_pixel;
    J.col(3) = d_pixel.col(2) * in_camera.y() - d_pixel.col(1) * in_camera.z();
    J.col(4) = d_pixel.col(0) * in_camera.z() - d_pixel.col(2) * in_camera.x();
    J.col(5) = d_pixel.col(1) * in_camera.x() - d_pixel.col(0) * in_camera.y();
    J.col(6).setZero();
  }
  if (jacobians[1]) Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>{jacobians[1]} = d_pixel * R;
  return true;
}

double squared_residual(const BundleProblem& problem, const BundleObservation& o) {
  const BundlePose& pose = problem.poses[static_cast<size_t>(o.pose)];
  const auto pixel =
      pose.camera->project(pose.camera_from_map * problem.points[static_cast<size_t>(o.point)]);
  if (!pixel) return std::numeric_limits<double>::infinity();
  return (*pixel - o.pixel).squaredNorm() * o.inverse_sigma * o.inverse_sigma;
}

BundleReport solve_bundle(BundleProblem* problem, const BundleOptions& options) {
  BundleReport report;
  report.observations = static_cast<int>(problem->observations.size());
  if (problem->observations.empty()) return report;
  const BundleProblem before = *problem;
  StopCallback callback(&options.should_stop);
  CeresBundle bundle(problem);
  for (int round = 0; round < options.rounds && !callback.stopped(); ++round) {
    report.squared_cutoff = robust_squared_cutoff(*problem, options.min_squared_cutoff);
    const int iterations = round + 1 < options.rounds ? kScaleRoundIterations : options.max_iterations;
    const ceres::Solver::Summary summary =
        bundle.solve(report.squared_cutoff, options, iterations, &callback);
    report.iterations += static_cast<int>(summary.iterations.size()) - 1;
    report.converged = summary.termination_type == ceres::CONVERGENCE;
    if (!summary.IsSolutionUsable()) break;
    bundle.write_poses();
  }
  report.initial_cost = robust_cost(before, report.squared_cutoff);
  report.final_cost = is_finite(*problem) ? robust_cost(*problem, report.squared_cutoff)
                                          : std::numeric_limits<double>::infinity();
  report.usable = std::isfinite(report.final_cost) && report.final_cost <= report.initial_cost * (1 + 1e-9);
  if (!report.usable) *problem = before;
  return report;
}

}  // namespace cairn
