// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/epipolar.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <limits>

#include "common/geometry/least_squares.h"
#include "common/geometry/levenberg_marquardt.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

// In units of sigma^2, 3.5 sigma: keeps nearly all of the good, none of the wild.
constexpr double kTukeyCutoff = 12.25;

double epipolar_cost(NormalizedMatches matches, const SE3& pose) {
  const Eigen::Matrix3d E = essential_of(pose);
  double cost = 0;
  for (const auto& m : matches) {
    cost += tukey_cost(sampson_error(E, m), kTukeyCutoff);
  }
  return cost;
}

/// Two unit vectors that span the plane orthogonal to t.
Eigen::Matrix<double, 3, 2> tangent_basis(const Eigen::Vector3d& t) {
  const Eigen::Vector3d u = t.unitOrthogonal();
  Eigen::Matrix<double, 3, 2> basis;
  basis << u, t.cross(u);
  return basis;
}

/// Normal equations of the Sampson residuals b^T [t]x R a / spread. The spread counts as constant: its change
/// multiplies a residual of zero mean.
LeastSquares<5> linearize(NormalizedMatches matches, const SE3& pose) {
  const Eigen::Matrix3d R = pose.rotation_matrix();
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Matrix3d E = skew(t) * R;
  const Eigen::Matrix<double, 3, 2> basis = tangent_basis(t);
  LeastSquares<5> equations;
  for (const auto& m : matches) {
    const Eigen::Vector3d line_b = E * m.a;
    const Eigen::Vector3d line_a = E.transpose() * m.b;
    const double variance =
        m.variance_b * line_b.head<2>().squaredNorm() + m.variance_a * line_a.head<2>().squaredNorm();
    const double algebraic = m.b.dot(line_b);
    const double weight = tukey_weight(algebraic * algebraic / variance, kTukeyCutoff) / variance;
    if (!(weight > 0)) continue;
    const Eigen::Vector3d rotated = R * m.a;
    Vector5d jacobian;
    jacobian << rotated.cross(m.b.cross(t)), basis.transpose() * rotated.cross(m.b);
    equations.add(jacobian, algebraic, weight);
  }
  return equations;
}

/// A pose with its cost.
struct Judged {
  SE3 pose;
  double cost;
};

}  // namespace

Eigen::Matrix3d essential_of(const SE3& b_from_a) {
  return skew(b_from_a.translation()) * b_from_a.rotation_matrix();
}

double sampson_error(const Eigen::Matrix3d& E, const NormalizedMatch& m) {
  const double x = m.a.x();
  const double y = m.a.y();
  const double u = m.b.x();
  const double v = m.b.y();
  const double bx = E(0, 0) * x + E(0, 1) * y + E(0, 2);
  const double by = E(1, 0) * x + E(1, 1) * y + E(1, 2);
  const double bz = E(2, 0) * x + E(2, 1) * y + E(2, 2);
  const double ax = E(0, 0) * u + E(1, 0) * v + E(2, 0);
  const double ay = E(0, 1) * u + E(1, 1) * v + E(2, 1);
  const double algebraic = u * bx + v * by + bz;
  return algebraic * algebraic / (m.variance_b * (bx * bx + by * by) + m.variance_a * (ax * ax + ay * ay));
}

SE3 pose_of_essential(const Eigen::Matrix3d& E) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(E, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d w;
  w << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  Eigen::Matrix3d rotation = svd.matrixU() * w * svd.matrixV().transpose();
  if (rotation.determinant() < 0) rotation = -rotation;
  return {rotation, svd.matrixU().col(2)};
}

std::array<SE3, 4> twisted_poses(const SE3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond half_turn(0, t.x(), t.y(), t.z());
  const Eigen::Quaterniond twisted = half_turn * pose.rotation();
  return {pose, SE3(pose.rotation(), -t), SE3(twisted, t), SE3(twisted, -t)};
}

SE3 refine_epipolar(NormalizedMatches matches, const SE3& start, int iterations) {
  Judged judged{start, epipolar_cost(matches, start)};
  LevenbergMarquardtOptions options;
  options.iterations = iterations;
  const auto step = [&](const Judged& from, const LeastSquares<5>& equations,
                        double damping) -> std::optional<Judged> {
    const auto by = equations.step(damping);
    if (!by) return std::nullopt;
    const Eigen::Vector3d& t = from.pose.translation();
    const SE3 pose(so3_exp(by->head<3>()) * from.pose.rotation(),
                   (t + tangent_basis(t) * by->tail<2>()).normalized());
    return Judged{pose, epipolar_cost(matches, pose)};
  };
  levenberg_marquardt(
      options, &judged, [&](const Judged& at) { return linearize(matches, at.pose); }, step,
      [](const Judged& at) { return at.cost; });
  return judged.pose;
}

double direction_uncertainty(NormalizedMatches matches, const SE3& pose) {
  const Eigen::SelfAdjointEigenSolver<Matrix5d> spectrum(linearize(matches, pose).information);
  if (!(spectrum.eigenvalues()(0) > 1e-12 * spectrum.eigenvalues()(4)))
    return std::numeric_limits<double>::infinity();
  const Matrix5d covariance = spectrum.eigenvectors() * spectrum.eigenvalues().cwiseInverse().asDiagonal() *
                              spectrum.eigenvectors().transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> direction(covariance.bottomRightCorner<2, 2>());
  return std::sqrt(direction.eigenvalues()(1));
}

}  // namespace cairn
