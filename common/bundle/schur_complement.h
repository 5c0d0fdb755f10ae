// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "common/bundle/bundle.h"
#include "common/bundle/camera_border.h"
#include "common/bundle/reduced_system.h"

/// The normal equations of a bundle problem with points eliminated (Schur complement; Triggs et al. 2000,
/// 6.1).
namespace cairn {

/// The values that an adjustment changes.
struct BundleState {
  std::vector<SE3> poses;               ///< camera_from_map, in the order of the problem
  std::vector<Eigen::Vector3d> points;  ///< map frame
  std::vector<CameraPtr> free_cameras;
};

/// A step of Levenberg-Marquardt from the state last linearized.
struct BundleStep {
  std::vector<Vector6d> poses;           ///< of the moving ones, ascending; exp(step) * camera_from_map
  std::vector<Eigen::Vector3d> points;   ///< added
  std::vector<Intrinsics> free_cameras;  ///< added
  double predicted_decrease = 0;         ///< of the cost, by the quadratic model
};

/// For a robust cost sum of rho(|r|^2) the model is that of iteratively reweighted least squares: weights
/// rho' frozen, second derivatives of rho left out. The cost may be Tukey's, so the full Hessian need not be
/// positive.
class SchurComplement {
 public:
  /// Sorts the observations; the problem's states may change afterwards, nothing else.
  SchurComplement(const BundleProblem& problem, const TileKernels& kernels);

  /// Cost of a state: sum of tukey_cost().
  [[nodiscard]] double cost(const BundleState& state, double squared_cutoff) const;

  /// Builds the reduced system at a state for a damping of `lambda` times the diagonal (Marquardt), and
  /// returns the cost there. Nothing when stopped. `should_stop`, here and below, is polled at least every
  /// millisecond or so.
  std::optional<double> linearize(const BundleState& state, double squared_cutoff, double lambda,
                                  const std::function<bool()>& should_stop);

  /// Solves for the step; once per linearize().
  [[nodiscard]] ReducedSystem::Outcome solve(BundleStep* step, const std::function<bool()>& should_stop);

  void apply(const BundleStep& step, const BundleState& from, BundleState* to) const;

  /// Inverse of the curvature of the cost by the intrinsics of each free camera, all else re-adjusted, at a
  /// state; nothing when stopped or singular. To be scaled by the noise.
  [[nodiscard]] std::optional<std::vector<Eigen::Matrix2d>> camera_covariances(
      const BundleState& state, double squared_cutoff, const std::function<bool()>& should_stop);

 private:
  struct Observation {
    int pose;
    int slot;  ///< of a moving pose that sees this point, -1 where either is fixed
    Eigen::Vector2d pixel;
    double inverse_sigma;
  };
  /// What the back-substitution needs of a point: V + lambda D = L L^T, y = L^-1 g.
  struct PointFactor {
    Eigen::Vector3d inverse_diagonal, lower, y;  ///< lower: l10, l20, l21
    Eigen::Vector3d gradient, diagonal;          ///< g, D
  };
  /// Sums of a moving pose: with M = w A^T A of each observation, A = d residual / d point in camera, x that
  /// point: U = [[sum M, .], [sum [x]M, sum [x]M[x]^T]] and gradient.
  struct PoseSums {
    Eigen::Matrix3d top_left, bottom_left, bottom_right;
    Vector6d gradient;
  };
  struct View {
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;
    const Camera* camera;
    int column;  ///< of the reduced system, -1 for a fixed pose
    int free_camera;
  };

  [[nodiscard]] std::vector<View> views(const BundleState& state) const;
  double accumulate(const std::vector<View>& views, size_t point, const Eigen::Vector3d& position,
                    double squared_cutoff, Eigen::Matrix3d* V, Eigen::Vector3d* g);
  void eliminate(size_t point, double lambda, const Eigen::Matrix3d& V, const Eigen::Vector3d& g);
  void add_pose_blocks(double lambda);

  std::vector<const Camera*> cameras_;  ///< of poses whose camera is not free
  std::vector<int> free_camera_;        ///< of each pose, -1 for none
  std::vector<int> column_of_pose_;
  std::vector<int> pose_of_column_;
  std::vector<bool> is_fixed_point_;
  std::vector<Observation> observations_;  ///< by point, then pose
  std::vector<int> first_observation_;     ///< of each point, and the end
  std::vector<int> first_slot_;            ///< of each point, and the end
  std::vector<int> column_of_slot_;
  std::vector<double> slots_;  ///< 6x3 each, by columns: W, then Z = W L^-T
  std::vector<PointFactor> factors_;
  std::vector<PoseSums> sums_;
  Eigen::VectorXd right_side_;
  std::optional<ReducedSystem> reduced_;
  CameraBorder border_;
  double lambda_ = 0;
};

}  // namespace cairn
