// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/se3.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <numbers>
#include <random>
#include <vector>

namespace cairn {
namespace {

constexpr double kPi = std::numbers::pi;

/// Rotation angles at which a closed form can lose digits, and some in between.
const std::vector<double> kAngles{0,     1e-14, 1e-10,      1e-7,       1e-4,       1e-2, 0.1,
                                  0.299, 0.301, 0.7,        0.99,       1.01,       1.7,  2.5,
                                  3.0,   3.1,   kPi - 1e-4, kPi - 1e-7, kPi - 1e-10};

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  Eigen::Vector3d vector(double size) {
    return size * Eigen::Vector3d{normal_(engine_), normal_(engine_), normal_(engine_)};
  }
  Eigen::Vector3d direction() { return vector(1).normalized(); }
  Vector6d tangent(double angle) {
    Vector6d xi;
    xi << vector(2), angle * direction();
    return xi;
  }
  Vector7d similarity_tangent(double angle, double log_scale) {
    Vector7d xi;
    xi << tangent(angle), log_scale;
    return xi;
  }
  SE3 pose() { return SE3::exp(tangent(std::abs(vector(1).x()))); }
  Similarity3 similarity() {
    return Similarity3::exp(similarity_tangent(vector(1).x(), 0.5 * vector(1).x()));
  }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

Eigen::Matrix4d matrix(const SE3& T) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = T.rotation_matrix();
  m.topRightCorner<3, 1>() = T.translation();
  return m;
}

Eigen::Matrix4d matrix(const Similarity3& S) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = S.scale() * S.rotation().toRotationMatrix();
  m.topRightCorner<3, 1>() = S.translation();
  return m;
}

TEST(So3, ExpIsTheRotationByTheAngleAboutTheAxis) {
  Random random(1);
  for (const double angle : kAngles) {
    const Eigen::Vector3d axis = random.direction();
    const Eigen::Quaterniond q = so3_exp(angle * axis);
    const Eigen::Matrix3d truth = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((q.toRotationMatrix() - truth).norm(), 1e-14) << "angle " << angle;
    EXPECT_NEAR(q.norm(), 1, 1e-15);
    EXPECT_GE(q.w(), 0);
  }
}

TEST(So3, ExpKeepsWNonNegativeBeyondPi) {
  const Eigen::Quaterniond q = so3_exp({0, 0, 4.0});
  EXPECT_GE(q.w(), 0);
  EXPECT_NEAR(so3_log(q).z(), 4.0 - 2 * kPi, 1e-14);
}

TEST(So3, LogInvertsExpForEveryAngleAndBothSignsOfTheQuaternion) {
  Random random(2);
  for (const double angle : kAngles) {
    const Eigen::Vector3d omega = angle * random.direction();
    const Eigen::Quaterniond q = so3_exp(omega);
    const Eigen::Quaterniond negated(-q.w(), -q.x(), -q.y(), -q.z());
    EXPECT_LT((so3_log(q) - omega).norm(), 1e-15 + 1e-14 * angle) << "angle " << angle;
    EXPECT_LT((so3_log(negated) - omega).norm(), 1e-15 + 1e-14 * angle) << "angle " << angle;
  }
}

TEST(So3, LeftJacobianIsTheDerivativeOfExp) {
  Random random(3);
  constexpr double kStep = 1e-6;
  for (const double angle : kAngles) {
    const Eigen::Vector3d omega = angle * random.direction();
    Eigen::Matrix3d numeric;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(k);
      const Eigen::Vector3d plus = so3_log(so3_exp(omega + d) * so3_exp(omega).conjugate());
      const Eigen::Vector3d minus = so3_log(so3_exp(omega - d) * so3_exp(omega).conjugate());
      numeric.col(k) = (plus - minus) / (2 * kStep);
    }
    EXPECT_LT((so3_left_jacobian(omega) - numeric).norm(), 1e-9) << "angle " << angle;
  }
}

TEST(So3, LeftJacobianInverseInverts) {
  Random random(4);
  for (const double angle : kAngles) {
    const Eigen::Vector3d omega = angle * random.direction();
    const Eigen::Matrix3d product = so3_left_jacobian(omega) * so3_left_jacobian_inverse(omega);
    EXPECT_LT((product - Eigen::Matrix3d::Identity()).norm(), 1e-14) << "angle " << angle;
  }
}

TEST(Se3, GroupLaws) {
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const SE3 A = random.pose();
    const SE3 B = random.pose();
    const SE3 C = random.pose();
    const Eigen::Vector3d p = random.vector(3);
    EXPECT_LT((matrix((A * B) * C) - matrix(A * (B * C))).norm(), 1e-13);
    EXPECT_LT((matrix(A * A.inverse()) - Eigen::Matrix4d::Identity()).norm(), 1e-14);
    EXPECT_LT((matrix(A * B) - matrix(A) * matrix(B)).norm(), 1e-13);
    EXPECT_LT(((A * B) * p - A * (B * p)).norm(), 1e-13);
    EXPECT_LT((A * A.center()).norm(), 1e-14);
  }
}

TEST(Se3, LogInvertsExp) {
  Random random(6);
  for (const double angle : kAngles) {
    const Vector6d xi = random.tangent(angle);
    EXPECT_LT((SE3::exp(xi).log() - xi).norm(), 1e-13) << "angle " << angle;
  }
}

TEST(Se3, ExpOfASumAlongOneDirectionIsTheProduct) {
  Random random(7);
  for (const double angle : kAngles) {
    const Vector6d xi = random.tangent(angle);
    const SE3 product = SE3::exp(0.3 * xi) * SE3::exp(0.7 * xi);
    EXPECT_LT((matrix(product) - matrix(SE3::exp(xi))).norm(), 1e-13) << "angle " << angle;
  }
}

TEST(Se3, AdjointMovesATangentAcross) {
  Random random(8);
  for (int i = 0; i < 100; ++i) {
    const SE3 T = random.pose();
    const Vector6d xi = random.tangent(0.8);
    EXPECT_LT((matrix(T * SE3::exp(xi)) - matrix(SE3::exp(T.adjoint() * xi) * T)).norm(), 1e-13);
  }
}

TEST(Se3, LeftJacobianIsTheDerivativeOfExp) {
  Random random(9);
  constexpr double kStep = 1e-6;
  for (const double angle : kAngles) {
    const Vector6d xi = random.tangent(angle);
    const SE3 inverse = SE3::exp(xi).inverse();
    Matrix6d numeric;
    for (int k = 0; k < 6; ++k) {
      const Vector6d d = kStep * Vector6d::Unit(k);
      numeric.col(k) =
          ((SE3::exp(xi + d) * inverse).log() - (SE3::exp(xi - d) * inverse).log()) / (2 * kStep);
    }
    EXPECT_LT((SE3::left_jacobian(xi) - numeric).norm(), 1e-8) << "angle " << angle;
  }
}

TEST(Se3, LeftJacobianIsContinuousWhereTheSeriesEnds) {
  Random random(10);
  const Vector6d direction = random.tangent(1);
  for (const double angle : {0.3, 1.0}) {
    Vector6d below = direction;
    Vector6d above = direction;
    below.tail<3>() *= angle * (1 - 1e-14);
    above.tail<3>() *= angle * (1 + 1e-14);
    EXPECT_LT((SE3::left_jacobian(below) - SE3::left_jacobian(above)).norm(), 2e-13);
  }
}

TEST(Se3, PointDerivativeMatchesDifferences) {
  Random random(11);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 20; ++i) {
    const SE3 T = random.pose();
    const Eigen::Vector3d p = random.vector(2);
    Eigen::Matrix<double, 3, 6> numeric;
    for (int k = 0; k < 6; ++k) {
      const Vector6d d = kStep * Vector6d::Unit(k);
      numeric.col(k) = (SE3::exp(d) * (T * p) - SE3::exp(-d) * (T * p)) / (2 * kStep);
    }
    EXPECT_LT((d_transformed_d_xi(T * p) - numeric).norm(), 1e-8);
  }
}

TEST(Similarity, GroupLaws) {
  Random random(12);
  for (int i = 0; i < 200; ++i) {
    const Similarity3 A = random.similarity();
    const Similarity3 B = random.similarity();
    const Similarity3 C = random.similarity();
    const Eigen::Vector3d p = random.vector(3);
    EXPECT_LT((matrix((A * B) * C) - matrix(A * (B * C))).norm(), 1e-11);
    EXPECT_LT((matrix(A * A.inverse()) - Eigen::Matrix4d::Identity()).norm(), 1e-13);
    EXPECT_LT((matrix(A * B) - matrix(A) * matrix(B)).norm(), 1e-11);
    EXPECT_LT(((A * B) * p - A * (B * p)).norm(), 1e-11);
  }
}

TEST(Similarity, LogInvertsExp) {
  Random random(13);
  for (const double angle : kAngles) {
    for (const double log_scale : {0.0, 1e-12, -1e-7, 1e-3, -0.4, 1.5, -3.0}) {
      const Vector7d xi = random.similarity_tangent(angle, log_scale);
      const double error = (Similarity3::exp(xi).log() - xi).norm();
      EXPECT_LT(error, 1e-12) << "angle " << angle << " log scale " << log_scale;
    }
  }
}

TEST(Similarity, ExpOfASumAlongOneDirectionIsTheProduct) {
  Random random(14);
  for (const double angle : kAngles) {
    const Vector7d xi = random.similarity_tangent(angle, 0.6);
    const Similarity3 product = Similarity3::exp(0.3 * xi) * Similarity3::exp(0.7 * xi);
    EXPECT_LT((matrix(product) - matrix(Similarity3::exp(xi))).norm(), 1e-12) << "angle " << angle;
  }
}

TEST(Similarity, ExpWithoutScaleIsThatOfSe3) {
  Random random(15);
  for (const double angle : kAngles) {
    const Vector7d xi = random.similarity_tangent(angle, 0);
    EXPECT_LT((matrix(Similarity3::exp(xi)) - matrix(SE3::exp(xi.head<6>()))).norm(), 1e-13)
        << "angle " << angle;
  }
}

TEST(Similarity, TransformedCameraSeesTheMovedPointsAlongTheSameRays) {
  Random random(16);
  for (int i = 0; i < 100; ++i) {
    const Similarity3 b_from_a = random.similarity();
    const SE3 camera_from_a = random.pose();
    const SE3 camera_from_b = b_from_a.transform_camera(camera_from_a);
    const Eigen::Vector3d p = random.vector(3);
    const Eigen::Vector3d seen = camera_from_b * (b_from_a * p);
    EXPECT_LT((seen - b_from_a.scale() * (camera_from_a * p)).norm(), 1e-11);
  }
}

}  // namespace
}  // namespace cairn
