// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/se3.h"

#include <cmath>

namespace cairn {
namespace {

// Below this angle the closed forms lose digits to cancellation and the power series are used: with the terms
// kept here their truncation error is under 1e-16.
constexpr double kSeriesAngle = 0.3;

/// (x - sin x) / x^3.
double x_minus_sin_over_x3(double x) {
  const double s = x * x;
  if (x > kSeriesAngle) return (x - std::sin(x)) / (s * x);
  return 1.0 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)));
}

/// (x^2 / 2 + cos x - 1) / x^4.
double cos_remainder_over_x4(double x) {
  const double s = x * x;
  if (x > 1.0) return (s / 2 + std::cos(x) - 1) / (s * s);
  return 1.0 / 24 *
         (1 - s / 30 * (1 - s / 56 * (1 - s / 90 * (1 - s / 132 * (1 - s / 182 * (1 - s / 240))))));
}

/// (2x - 3 sin x + x cos x) / (2 x^5): the series is sum over k >= 2 of (-1)^k (k - 1) x^(2k-4) / (2k + 1)!.
double barfoot_last_coefficient(double x) {
  const double s = x * x;
  if (x > 1.0) return (2 * x - 3 * std::sin(x) + x * std::cos(x)) / (2 * s * s * x);
  double sum = 0;
  double power_over_factorial = 1.0 / 120;
  for (int k = 2; k < 10; ++k) {
    sum += (k - 1) * power_over_factorial;
    power_over_factorial *= -s / ((2 * k + 2) * (2 * k + 3));
  }
  return sum;
}

}  // namespace

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Eigen::Quaterniond so3_exp(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double sinc_half = angle < 1e-12 ? 0.5 : std::sin(0.5 * angle) / angle;
  Eigen::Quaterniond q(std::cos(0.5 * angle), sinc_half * omega.x(), sinc_half * omega.y(),
                       sinc_half * omega.z());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return q;
}

Eigen::Vector3d so3_log(const Eigen::Quaterniond& q) {
  // q and -q are one rotation; the one with w >= 0 has the angle within pi.
  const double sign = q.w() < 0 ? -1.0 : 1.0;
  const double w = sign * q.w();
  const double sin_half = q.vec().norm();
  const double factor = sin_half < 1e-12 ? 2.0 / w : 2.0 * std::atan2(sin_half, w) / sin_half;
  return sign * factor * q.vec();
}

Eigen::Matrix3d so3_left_jacobian(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double sinc_half = angle < 1e-12 ? 0.5 : std::sin(0.5 * angle) / angle;
  const Eigen::Matrix3d w = skew(omega);
  return Eigen::Matrix3d::Identity() + 2 * sinc_half * sinc_half * w + x_minus_sin_over_x3(angle) * w * w;
}

Eigen::Matrix3d so3_left_jacobian_inverse(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double half = 0.5 * angle;
  const double s = half * half;
  // (1 - x cot x) / (2x)^2 with x = angle / 2.
  const double c =
      angle < kSeriesAngle
          ? 0.25 * (1.0 / 3 + s * (1.0 / 45 + s * (2.0 / 945 + s * (1.0 / 4725 + s * 2.0 / 93555))))
          : (1 - half * std::cos(half) / std::sin(half)) / (4 * s);
  const Eigen::Matrix3d w = skew(omega);
  return Eigen::Matrix3d::Identity() - 0.5 * w + c * w * w;
}

SE3 SE3::exp(const Vector6d& xi) {
  const Eigen::Vector3d omega = xi.tail<3>();
  return {so3_exp(omega), so3_left_jacobian(omega) * xi.head<3>()};
}

Vector6d SE3::log() const {
  Vector6d xi;
  xi.tail<3>() = so3_log(rotation_);
  xi.head<3>() = so3_left_jacobian_inverse(xi.tail<3>()) * translation_;
  return xi;
}

SE3 SE3::inverse() const {
  const Eigen::Quaterniond inverse_rotation = rotation_.conjugate();
  return {inverse_rotation, -(inverse_rotation * translation_)};
}

Matrix6d SE3::adjoint() const {
  const Eigen::Matrix3d r = rotation_matrix();
  Matrix6d a;
  a << r, skew(translation_) * r, Eigen::Matrix3d::Zero(), r;
  return a;
}

// Barfoot and Furgale, "Associating uncertainty with three-dimensional poses" (T-RO 2014), eq. 100-102.
Matrix6d SE3::left_jacobian(const Vector6d& xi) {
  const double angle = xi.tail<3>().norm();
  const Eigen::Matrix3d rho = skew(xi.head<3>());
  const Eigen::Matrix3d phi = skew(xi.tail<3>());
  const Eigen::Matrix3d phi_rho = phi * rho;
  const Eigen::Matrix3d rho_phi = rho * phi;
  const Eigen::Matrix3d phi_rho_phi = phi_rho * phi;
  const Eigen::Matrix3d q = 0.5 * rho + x_minus_sin_over_x3(angle) * (phi_rho + rho_phi + phi_rho_phi) +
                            cos_remainder_over_x4(angle) * (phi * phi_rho + rho_phi * phi - 3 * phi_rho_phi) +
                            barfoot_last_coefficient(angle) * (phi_rho_phi * phi + phi * phi_rho_phi);
  const Eigen::Matrix3d j = so3_left_jacobian(xi.tail<3>());
  Matrix6d result;
  result << j, q, Eigen::Matrix3d::Zero(), j;
  return result;
}

Eigen::Matrix<double, 3, 6> d_transformed_d_xi(const Eigen::Vector3d& transformed_point) {
  Eigen::Matrix<double, 3, 6> j;
  j << Eigen::Matrix3d::Identity(), -skew(transformed_point);
  return j;
}

}  // namespace cairn
