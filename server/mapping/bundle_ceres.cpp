// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/bundle_ceres.h"

#include <ceres/ceres.h>

#include <array>
#include <cmath>
#include <deque>

#include "common/bundle/bundle_rounds.h"

namespace cairn {
namespace {

constexpr double kHugeResidual = 1e6;

using PoseParameters = std::array<double, kPoseParameters>;

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const std::function<bool()>* should_stop) : should_stop_(should_stop) {}
  // ABORT would put the parameters back (measured with Ceres 2.1).
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
  CeresBundle(BundleProblem* problem, const CeresVariant& variant)
      : problem_(problem), variant_(variant), ceres_(make_options()) {
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

  ceres::Solver::Summary solve(double squared_cutoff, double function_tolerance, int max_iterations,
                               StopCallback* callback) {
    loss_.Reset(std::make_unique<ceres::TukeyLoss>(std::sqrt(squared_cutoff)).release(),
                ceres::TAKE_OWNERSHIP);
    ceres::Solver::Options o;
    if (variant_.ordered_by_hand) o.linear_solver_ordering = ordering_;
    o.linear_solver_type = variant_.linear_solver;
    if (variant_.linear_solver == ceres::ITERATIVE_SCHUR) {
      o.preconditioner_type = ceres::SCHUR_JACOBI;
      o.use_explicit_schur_complement = variant_.explicit_schur;
    }
    o.max_num_iterations = max_iterations;
    o.function_tolerance = function_tolerance;
    o.num_threads = 1;
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
    for (size_t i = 0; i < problem_->points.size(); ++i) {
      double* point = problem_->points[i].data();
      if (!ceres_.HasParameterBlock(point)) continue;
      ordering_->AddElementToGroup(point, 0);
      if (problem_->is_fixed_point(i)) ceres_.SetParameterBlockConstant(point);
    }
    for (size_t i = 0; i < poses_.size(); ++i) {
      double* pose = poses_[i].data();
      if (!ceres_.HasParameterBlock(pose)) continue;
      ceres_.SetManifold(pose, &manifold_);
      ordering_->AddElementToGroup(pose, 1);
      if (problem_->poses[i].fixed) ceres_.SetParameterBlockConstant(pose);
    }
  }

  BundleProblem* problem_;
  CeresVariant variant_;
  PoseManifold manifold_;
  ceres::LossFunctionWrapper loss_{nullptr, ceres::TAKE_OWNERSHIP};
  std::vector<PoseParameters> poses_;
  std::deque<ReprojectionCost> costs_;  // Ceres keeps addresses
  ceres::Problem ceres_;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_;
};

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

BundleReport solve_bundle_with_ceres(BundleProblem* problem, const BundleOptions& options,
                                     const CeresVariant& variant) {
  CeresBundle bundle(problem, variant);
  return solve_in_rounds(problem, options, [&](double squared_cutoff, int max_iterations) {
    StopCallback callback(&options.should_stop);
    const ceres::Solver::Summary summary =
        bundle.solve(squared_cutoff, options.function_tolerance, max_iterations, &callback);
    MinimizationReport report;
    report.usable = summary.IsSolutionUsable();
    report.converged = summary.termination_type == ceres::CONVERGENCE;
    report.stopped = callback.stopped();
    report.iterations = static_cast<int>(summary.iterations.size()) - 1;
    if (report.usable) bundle.write_poses();
    return report;
  });
}

}  // namespace cairn
