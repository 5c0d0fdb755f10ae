// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include "common/geometry/epipolar.h"
#include "common/geometry/least_squares.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr double kTukeyCutoff = 16;  // 4 sigma

/// Projective coordinates of the fourth point in the basis of the first three; false if three of the four are
/// collinear.
bool projective_basis(const std::array<Eigen::Vector3d, 4>& p, Eigen::Matrix3d* basis,
                      Eigen::Vector3d* coordinates) {
  *basis << p[0], p[1], p[2];
  const double determinant = basis->determinant();
  if (!(std::abs(determinant) > 1e-6)) return false;
  *coordinates = basis->inverse() * p[3];
  return coordinates->cwiseAbs().minCoeff() > 1e-3;
}

}  // namespace

double transfer_error(const Eigen::Matrix3d& b_from_a, const Eigen::Matrix3d& a_from_b,
                      const NormalizedMatch& m) {
  const Eigen::Vector3d in_b = b_from_a * m.a;
  const Eigen::Vector3d in_a = a_from_b * m.b;
  const double forward = (in_b.head<2>() / in_b.z() - m.b.head<2>()).squaredNorm();
  const double backward = (in_a.head<2>() / in_a.z() - m.a.head<2>()).squaredNorm();
  return 0.5 * (forward + backward) / (m.variance_a + m.variance_b);
}

bool solve_four_point(const std::array<NormalizedMatch, 4>& sample, Eigen::Matrix3d* H) {
  Eigen::Matrix3d A;
  Eigen::Matrix3d B;
  Eigen::Vector3d in_a;
  Eigen::Vector3d in_b;
  if (!projective_basis({sample[0].a, sample[1].a, sample[2].a, sample[3].a}, &A, &in_a)) return false;
  if (!projective_basis({sample[0].b, sample[1].b, sample[2].b, sample[3].b}, &B, &in_b)) return false;
  // A plane seen from one side keeps the orientation of every triple (Werner and Pajdla 2001): cheap, and
  // rejects most samples with an outlier.
  const Eigen::Vector3d ratio = in_b.cwiseQuotient(in_a);
  if (!(ratio.minCoeff() > 0)) return false;
  *H = B * ratio.asDiagonal() * A.inverse();
  H->normalize();
  return true;
}

Eigen::Matrix3d refine_homography(NormalizedMatches matches, Eigen::Matrix3d H, int iterations) {
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Eigen::Matrix<double, 9, 9> scatter = Eigen::Matrix<double, 9, 9>::Zero();
    for (const auto& m : matches) {
      const Eigen::Vector3d in_b = H * m.a;
      const double variance = m.variance_a + m.variance_b;
      const double squared = (in_b.head<2>() / in_b.z() - m.b.head<2>()).squaredNorm() / variance;
      const double weight = tukey_weight(squared, kTukeyCutoff) / (variance * in_b.z() * in_b.z());
      if (!(weight > 0)) continue;
      // Rows (a, 0, -b_x a) and (0, a, -b_y a): the scatter is made of multiples of a a^T.
      const Eigen::Matrix3d aa = weight * m.a * m.a.transpose();
      scatter.block<3, 3>(0, 0) += aa;
      scatter.block<3, 3>(6, 0) -= m.b.x() * aa;
      scatter.block<3, 3>(6, 3) -= m.b.y() * aa;
      scatter.block<3, 3>(6, 6) += m.b.head<2>().squaredNorm() * aa;
    }
    scatter.block<3, 3>(3, 3) = scatter.block<3, 3>(0, 0);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> solver(
        scatter);  // reads the lower triangle
    const Eigen::Matrix<double, 9, 1> h = solver.eigenvectors().col(0);
    if (solver.info() != Eigen::Success || !h.allFinite()) break;
    H = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.data());
  }
  return H;
}

std::vector<PlaneMotion> decompose_homography(const Eigen::Matrix3d& H) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(H.determinant() < 0 ? Eigen::Matrix3d(-H) : H,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d& U = svd.matrixU();
  const Eigen::Matrix3d& V = svd.matrixV();
  const double sign = U.determinant() * V.determinant();
  // The middle singular value of R + t n^T is 1, which fixes the scale.
  const double d1 = svd.singularValues()(0) / svd.singularValues()(1);
  const double d3 = svd.singularValues()(2) / svd.singularValues()(1);
  if (!(d3 > 0) || !(d1 - d3 > 1e-9)) return {};

  const double spread = d1 * d1 - d3 * d3;
  const double x1 = std::sqrt(std::max(d1 * d1 - 1, 0.0) / spread);
  const double x3 = std::sqrt(std::max(1 - d3 * d3, 0.0) / spread);
  const double sine = std::sqrt(std::max((d1 * d1 - 1) * (1 - d3 * d3), 0.0)) / (d1 + d3);
  const double cosine = (1 + d1 * d3) / (d1 + d3);
  std::vector<PlaneMotion> solutions;
  for (const double e1 : {1.0, -1.0}) {
    for (const double e3 : {1.0, -1.0}) {
      const double s = e1 * e3 * sine;
      Eigen::Matrix3d rotation;
      rotation << cosine, 0, -s, 0, 1, 0, s, 0, cosine;
      const Eigen::Vector3d translation(e1 * x1, 0, -e3 * x3);
      const Eigen::Vector3d normal(e1 * x1, 0, e3 * x3);
      solutions.push_back(
          {SE3(Eigen::Matrix3d(sign * U * rotation * V.transpose()), (U * translation).normalized()),
           sign * (V * normal)});
    }
  }
  return solutions;
}

Eigen::Matrix3d fit_rotation(NormalizedMatches matches, const Eigen::Matrix3d& H, int iterations) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(H.determinant() < 0 ? Eigen::Matrix3d(-H) : H,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  for (int iteration = 0; iteration < iterations; ++iteration) {
    LeastSquares<3> equations;
    for (const auto& m : matches) {
      const Eigen::Vector3d p = rotation * m.a;
      const Eigen::Vector2d projected = p.head<2>() / p.z();
      const Eigen::Vector2d residual = projected - m.b.head<2>();
      const double variance = m.variance_a + m.variance_b;
      const double weight = tukey_weight(residual.squaredNorm() / variance, kTukeyCutoff) / variance;
      if (!(weight > 0)) continue;
      Eigen::Matrix<double, 2, 3> d_projected;
      d_projected << 1, 0, -projected.x(), 0, 1, -projected.y();
      const Eigen::Matrix<double, 2, 3> jacobian = d_projected / p.z() * -skew(p);
      equations.add(jacobian, residual, weight);
    }
    const auto step = equations.step();
    if (!step) break;
    rotation = so3_exp(*step) * rotation;
  }
  return rotation;
}

}  // namespace cairn
