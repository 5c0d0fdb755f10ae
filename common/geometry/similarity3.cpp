// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

/// W(omega, lambda) = integral over s in [0, 1] of exp(s (lambda I + [omega]x)), the map from the tangent's
/// translation to the group's. Its closed form divides by omega and lambda; as a block of a 6x6 matrix
/// exponential it has no special cases (Van Loan 1978).
Eigen::Matrix3d translation_map(const Eigen::Vector3d& omega, double lambda) {
  Matrix6d m = Matrix6d::Zero();
  m.topLeftCorner<3, 3>() = lambda * Eigen::Matrix3d::Identity() + skew(omega);
  m.topRightCorner<3, 3>() = Eigen::Matrix3d::Identity();
  const Matrix6d e = m.exp();
  return e.topRightCorner<3, 3>();
}

}  // namespace

Similarity3 Similarity3::exp(const Vector7d& xi) {
  const Eigen::Vector3d omega = xi.segment<3>(3);
  return {std::exp(xi(6)), so3_exp(omega), translation_map(omega, xi(6)) * xi.head<3>()};
}

Vector7d Similarity3::log() const {
  Vector7d xi;
  const Eigen::Vector3d omega = so3_log(rotation_);
  const double lambda = std::log(scale_);
  xi << translation_map(omega, lambda).partialPivLu().solve(translation_), omega, lambda;
  return xi;
}

Similarity3 Similarity3::inverse() const {
  const Eigen::Quaterniond inverse_rotation = rotation_.conjugate();
  return {1.0 / scale_, inverse_rotation, -(inverse_rotation * translation_) / scale_};
}

Similarity3 Similarity3::operator*(const Similarity3& other) const {
  return {scale_ * other.scale_, rotation_ * other.rotation_, *this * other.translation_};
}

SE3 Similarity3::transform_camera(const SE3& camera_from_a) const {
  const Eigen::Quaterniond camera_from_b = camera_from_a.rotation() * rotation_.conjugate();
  const Eigen::Vector3d center_in_b = *this * camera_from_a.center();
  return {camera_from_b, -(camera_from_b * center_in_b)};
}

}  // namespace cairn
