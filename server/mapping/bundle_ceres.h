// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include "common/bundle/bundle.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

/// Ceres as an independent check of solve_bundle(): the same problem, the same robust cost. It runs in tests,
/// in benchmarks, and in a server that is started with --adjuster ceres.
namespace cairn {

/// A pose as Ceres sees it: tx ty tz qx qy qz qw of camera_from_map.
constexpr int kPoseParameters = 7;
void pose_to_parameters(const SE3& camera_from_map, double* parameters);
[[nodiscard]] SE3 pose_from_parameters(const double* parameters);

/// SE(3) with left perturbation: Plus(T, xi) = exp(xi) T. Cost functions give derivatives by xi in the first
/// six of seven columns, so the Jacobian of Plus is the identity over a zero row ("lifted" Jacobians, as in
/// Leutenegger et al., IJRR 2015).
class PoseManifold final : public ceres::Manifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return kPoseParameters; }
  [[nodiscard]] int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// Reprojection error (project(camera_from_map * point) - pixel) / sigma. A point that does not project has a
/// constant, huge residual: an outlier to the robust loss, no failure of the evaluation.
class ReprojectionCost final : public ceres::SizedCostFunction<2, kPoseParameters, 3> {
 public:
  /// `camera` outlives the cost.
  ReprojectionCost(const Camera* camera, Eigen::Vector2d pixel, double inverse_sigma)
      : camera_(camera), pixel_(std::move(pixel)), inverse_sigma_(inverse_sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const Camera* camera_;
  Eigen::Vector2d pixel_;
  double inverse_sigma_;
};

struct CeresVariant {
  ceres::LinearSolverType linear_solver = ceres::DENSE_SCHUR;
  bool explicit_schur = false;  ///< whether ITERATIVE_SCHUR forms the complement
  bool ordered_by_hand = true;  ///< whether points are eliminated first; otherwise Ceres finds an order
};

/// Solves a problem as solve_bundle() does, but by Ceres. Cameras stay as they are, free ones too.
/// should_stop is polled once per iteration.
BundleReport solve_bundle_with_ceres(BundleProblem* problem, const BundleOptions& options,
                                     const CeresVariant& variant);

}  // namespace cairn
