// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <optional>

namespace cairn {

/// Normal equations of a weighted least-squares problem in `N` unknowns: J^T W J x = -J^T W r, summed up
/// residual by residual. Poses that many points are seen from have faster ones (normal_equations.h).
template <int N>
struct LeastSquares {
  using Vector = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;

  Matrix information = Matrix::Zero();  ///< J^T W J
  Vector gradient = Vector::Zero();     ///< J^T W r

  /// A residual that is a number; `jacobian` is its derivative as a column.
  void add(const Vector& jacobian, double residual, double weight = 1) {
    information.noalias() += weight * jacobian * jacobian.transpose();
    gradient.noalias() += weight * residual * jacobian;
  }
  /// A residual of several rows.
  template <int Rows>
  void add(const Eigen::Matrix<double, Rows, N>& jacobian, const Eigen::Matrix<double, Rows, 1>& residual,
           double weight = 1) {
    information.noalias() += weight * jacobian.transpose() * jacobian;
    gradient.noalias() += weight * jacobian.transpose() * residual;
  }
  /// The step to the minimum of the linear problem. `damping` is that of Levenberg and Marquardt, relative to
  /// the diagonal. Nothing if the equations have no solution.
  [[nodiscard]] std::optional<Vector> step(double damping = 0) const {
    Matrix damped = information;
    damped.diagonal() *= 1 + damping;
    const Vector x = -damped.ldlt().solve(gradient);
    if (!x.allFinite()) return std::nullopt;
    return x;
  }
};

}  // namespace cairn
