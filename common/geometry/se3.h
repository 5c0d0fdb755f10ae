// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace cairn {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// [v]x: skew(v) * w == v.cross(w).
[[nodiscard]] Eigen::Matrix3d skew(const Eigen::Vector3d& v);

/// exp of so(3), unit quaternion with w >= 0; exact to rounding for every angle, also near 0 and pi.
[[nodiscard]] Eigen::Quaterniond so3_exp(const Eigen::Vector3d& omega);
/// log of SO(3), |result| <= pi.
[[nodiscard]] Eigen::Vector3d so3_log(const Eigen::Quaterniond& q);
/// Left Jacobian of SO(3): exp(omega + d) ~ exp(J d) exp(omega).
[[nodiscard]] Eigen::Matrix3d so3_left_jacobian(const Eigen::Vector3d& omega);
[[nodiscard]] Eigen::Matrix3d so3_left_jacobian_inverse(const Eigen::Vector3d& omega);

/// Rigid motion, named `b_from_a`: point_in_b = b_from_a * point_in_a; c_from_a = c_from_b * b_from_a.
/// Tangent vectors are (translation [unit of the frames, such as map unit], rotation [rad]) and act on the
/// LEFT: exp(xi) * T.
class SE3 {
 public:
  SE3() = default;  ///< identity
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(unit(rotation)), translation_(translation) {}
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : SE3(Eigen::Quaterniond(rotation), translation) {}

  [[nodiscard]] const Eigen::Quaterniond& rotation() const { return rotation_; }
  [[nodiscard]] const Eigen::Vector3d& translation() const { return translation_; }
  [[nodiscard]] Eigen::Matrix3d rotation_matrix() const { return rotation_.toRotationMatrix(); }

  [[nodiscard]] static SE3 exp(const Vector6d& xi);
  [[nodiscard]] Vector6d log() const;
  [[nodiscard]] SE3 inverse() const;
  /// Adjoint: T exp(xi) == exp(T.adjoint() * xi) T.
  [[nodiscard]] Matrix6d adjoint() const;
  /// Left Jacobian of SE(3) at xi: exp(xi + d) ~ exp(J d) exp(xi).
  [[nodiscard]] static Matrix6d left_jacobian(const Vector6d& xi);

  [[nodiscard]] SE3 operator*(const SE3& other) const {
    return {rotation_ * other.rotation_, rotation_ * other.translation_ + translation_};
  }
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation_ * point + translation_;
  }
  /// The origin of the target frame in the source frame: the camera centre of a `camera_from_map`.
  [[nodiscard]] Eigen::Vector3d center() const { return -(rotation_.conjugate() * translation_); }
  [[nodiscard]] bool is_finite() const { return rotation_.coeffs().allFinite() && translation_.allFinite(); }

 private:
  /// Normalizing twice would change the last bit now and then: what is unit to rounding stays, so poses
  /// survive the wire exactly.
  static Eigen::Quaterniond unit(const Eigen::Quaterniond& q) {
    constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();
    return std::abs(q.squaredNorm() - 1.0) <= kRounding ? q : q.normalized();
  }

  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation_ = Eigen::Vector3d::Zero();
};

/// d (T * p) / d xi at xi = 0 for exp(xi) * T: [I | -skew(T * p)], given the transformed point T * p.
[[nodiscard]] Eigen::Matrix<double, 3, 6> d_transformed_d_xi(const Eigen::Vector3d& transformed_point);

/// Similarity: point_in_b = scale * (rotation * point_in_a) + translation. Tangent (translation, rotation,
/// log scale), left.
class Similarity3 {
 public:
  Similarity3() = default;
  Similarity3(double scale, const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation), scale_(scale) {}
  explicit Similarity3(const SE3& rigid) : Similarity3(1.0, rigid.rotation(), rigid.translation()) {}

  [[nodiscard]] double scale() const { return scale_; }
  [[nodiscard]] const Eigen::Quaterniond& rotation() const { return rotation_; }
  [[nodiscard]] const Eigen::Vector3d& translation() const { return translation_; }

  [[nodiscard]] static Similarity3 exp(const Vector7d& xi);
  [[nodiscard]] Vector7d log() const;
  [[nodiscard]] Similarity3 inverse() const;
  [[nodiscard]] Similarity3 operator*(const Similarity3& other) const;
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale_ * (rotation_ * point) + translation_;
  }
  /// The pose of a camera in the new frame: given b_from_a and camera_from_a, camera_from_b up to the unit of
  /// length of b (rotations composed, camera centre mapped).
  [[nodiscard]] SE3 transform_camera(const SE3& camera_from_a) const;

 private:
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation_ = Eigen::Vector3d::Zero();
  double scale_ = 1.0;
};

}  // namespace cairn
