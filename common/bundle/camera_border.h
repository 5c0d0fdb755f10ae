// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "common/bundle/free_camera.h"
#include "common/bundle/reduced_system.h"

/// What free cameras add to the reduced system of a bundle problem.
namespace cairn {

/// The reduced system [S B; B^T K] of poses and free cameras: S is ReducedSystem's, B and K are here, dense,
/// and so are the couplings of points and cameras that make them. Few cameras are free, mostly one or none.
class CameraBorder {
 public:
  CameraBorder(const std::vector<FreeCamera>& cameras, int poses, size_t points);

  [[nodiscard]] bool empty() const { return cameras_.empty(); }
  void set_zero();

  /// An observation of a point under way, whitened: J = d residual / d intrinsics of `camera`, r the
  /// residual, JA = J^T A with A = d residual / d point in camera coordinates x. `column`: of its pose, -1 if
  /// fixed.
  struct Share {
    int camera;
    int column;
    double weight;
    Eigen::Matrix2d J;
    Eigen::Vector2d r;
    Eigen::Matrix<double, kIntrinsics, kPointSize> JA;
    const Eigen::Vector3d& x;
    const Eigen::Matrix3d& rotation;
  };
  void add(const Share& share);
  /// Eliminates `point`, all of whose observations have been added. V = L L^T is given by the inverse of its
  /// diagonal and what is below (l10, l20, l21), y = L^-1 g, Z = W L^-T for each pose that sees it.
  void eliminate(size_t point, const Eigen::Vector3d& inverse_diagonal, const Eigen::Vector3d& lower,
                 const Eigen::Vector3d& y, std::span<const double> Z, std::span<const int> columns);
  /// The cost that the priors add when the free cameras are `cameras`.
  [[nodiscard]] double prior_cost(const std::vector<CameraPtr>& cameras, double squared_cutoff) const;
  /// Adds the priors and the damping `lambda` to the system, which is complete but for these.
  void finish(const std::vector<CameraPtr>& cameras, double squared_cutoff, double lambda);

  /// The cameras' step, by the factor of S; `poses` goes in as S^-1 times the poses' right side, and comes
  /// out as minus their step.
  void solve(const ReducedSystem& factor, Eigen::VectorXd* poses);
  [[nodiscard]] const Eigen::VectorXd& step() const { return step_; }
  /// d^T (lambda D d - g) of the last step d.
  [[nodiscard]] double decrease() const;
  /// A point's share L^-1 W_c^T d in the back-substitution.
  [[nodiscard]] Eigen::Vector3d back_substitute(size_t point) const;

  /// Inverse of the curvature of the cost by the cameras alone, all else re-adjusted: (K - B^T S^-1 B)^-1.
  [[nodiscard]] Eigen::MatrixXd inverse_curvature(const ReducedSystem& factor) const;

 private:
  [[nodiscard]] Eigen::MatrixXd solve_border(const ReducedSystem& factor) const;

  std::vector<FreeCamera> cameras_;
  Eigen::MatrixXd border_;      ///< B, 6 * poses x 2 * cameras
  Eigen::MatrixXd corner_;      ///< K, damped once finished
  Eigen::VectorXd gradient_;    ///< whole
  Eigen::VectorXd diagonal_;    ///< of K before points are eliminated: what is damped
  Eigen::VectorXd right_side_;  ///< reduced
  Eigen::Matrix3Xd coupling_;   ///< of the point under way: W_c^T, 3 x 2 * cameras
  Eigen::MatrixXd couplings_;   ///< of each point, eliminated: L^-1 W_c^T, side by side
  Eigen::VectorXd step_;
  double lambda_ = 0;
};

}  // namespace cairn
