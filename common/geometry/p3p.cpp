// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "common/geometry/pose.h"

// Persson and Nordberg, "Lambda Twist: An Accurate Fast Robust Perspective Three Point (P3P) Solver" (ECCV
// 2018). Unknown are the ranges lambda along the three rays; each pair gives lambda^T M_ij lambda = |x_i -
// x_j|^2. Two combinations of these are homogeneous conics; the degenerate member of their pencil splits into
// two planes, and each plane cut with the other conic gives up to two directions of lambda.
namespace cairn {
namespace {

struct RangeEquations {
  std::array<Eigen::Matrix3d, 3> m;  ///< of the pairs 12, 13, 23
  std::array<double, 3> squared_distance;
};

RangeEquations range_equations(std::span<const Eigen::Vector3d, 3> rays,
                               std::span<const Eigen::Vector3d, 3> points) {
  constexpr std::array<std::pair<int, int>, 3> kPairs{{{0, 1}, {0, 2}, {1, 2}}};
  RangeEquations e;
  for (size_t k = 0; k < 3; ++k) {
    const auto [i, j] = kPairs[k];
    e.m[k].setZero();
    e.m[k](i, i) = e.m[k](j, j) = 1;
    e.m[k](i, j) = e.m[k](j, i) = -rays[static_cast<size_t>(i)].dot(rays[static_cast<size_t>(j)]);
    e.squared_distance[k] = (points[static_cast<size_t>(i)] - points[static_cast<size_t>(j)]).squaredNorm();
  }
  return e;
}

/// Coefficients c0..c3 of det(A + g B).
std::array<double, 4> pencil_determinant(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) {
  const auto mixed = [](const Eigen::Matrix3d& P, const Eigen::Matrix3d& Q) {  // d/dg det(P + g Q) at 0
    return Q.col(0).dot(P.col(1).cross(P.col(2))) + P.col(0).dot(Q.col(1).cross(P.col(2))) +
           P.col(0).dot(P.col(1).cross(Q.col(2)));
  };
  return {A.determinant(), mixed(A, B), mixed(B, A), B.determinant()};
}

/// The real root of c0 + c1 g + c2 g^2 + c3 g^3 (c3 != 0) where the cubic is steepest: the best conditioned.
double steepest_cubic_root(const std::array<double, 4>& c) {
  const double b = c[2] / (3 * c[3]);
  const double p = c[1] / (3 * c[3]) - b * b;
  const double q = b * b * b + 0.5 * (c[0] - c[1] * b) / c[3];
  std::array<double, 3> roots{};
  int count = 1;
  const double discriminant = q * q + p * p * p;
  if (discriminant >= 0) {
    const double s = std::cbrt(-q - std::copysign(std::sqrt(discriminant), q));
    roots[0] = (s == 0 ? 0 : s - p / s) - b;
  } else {
    const double radius = 2 * std::sqrt(-p);
    const double angle = std::acos(std::clamp(-q / std::sqrt(-p * p * p), -1.0, 1.0)) / 3;
    count = 3;
    for (int k = 0; k < 3; ++k) {
      roots[static_cast<size_t>(k)] = radius * std::cos(angle - 2 * std::numbers::pi / 3 * k) - b;
    }
  }
  const auto slope = [&](double g) { return c[1] + g * (2 * c[2] + g * 3 * c[3]); };
  double best = *std::max_element(roots.begin(), roots.begin() + count, [&](double x, double y) {
    return std::abs(slope(x)) < std::abs(slope(y));
  });
  for (int i = 0; i < 3; ++i) {
    const double d = slope(best);
    if (d != 0) best -= (c[0] + best * (c[1] + best * (c[2] + best * c[3]))) / d;
  }
  return best;
}

/// Newton on the three range equations from a good start.
Eigen::Vector3d polish(const RangeEquations& e, Eigen::Vector3d lambda) {
  for (int iteration = 0; iteration < 4; ++iteration) {
    Eigen::Matrix3d jacobian;
    Eigen::Vector3d residual;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d m_lambda = e.m[static_cast<size_t>(k)] * lambda;
      residual(k) = lambda.dot(m_lambda) - e.squared_distance[static_cast<size_t>(k)];
      jacobian.row(k) = 2 * m_lambda.transpose();
    }
    const Eigen::Vector3d step = jacobian.partialPivLu().solve(residual);
    if (!step.allFinite()) break;
    lambda -= step;
  }
  return lambda;
}

/// Ranges along a direction (up to sign and length), scaled to the distances; nothing unless all are
/// positive.
std::optional<Eigen::Vector3d> ranges_along(const RangeEquations& e, Eigen::Vector3d direction) {
  if (direction.sum() < 0) direction = -direction;
  const double tolerance = 1e-9 * direction.maxCoeff();
  if (!(direction.minCoeff() > tolerance)) return std::nullopt;
  double model = 0;
  double measured = 0;
  for (size_t k = 0; k < 3; ++k) {
    model += direction.dot(e.m[k] * direction);
    measured += e.squared_distance[k];
  }
  if (!(model > 0)) return std::nullopt;
  const Eigen::Vector3d lambda = polish(e, std::sqrt(measured / model) * direction);
  if (!lambda.allFinite() || !(lambda.minCoeff() > 0)) return std::nullopt;
  return lambda;
}

/// Directions where the plane normal^T lambda = 0 meets the conic lambda^T D lambda = 0.
std::vector<Eigen::Vector3d> plane_conic_directions(const Eigen::Vector3d& normal, const Eigen::Matrix3d& D) {
  const Eigen::Vector3d u = normal.unitOrthogonal();
  const Eigen::Vector3d v = normal.normalized().cross(u);
  const double a = u.dot(D * u);
  const double b = u.dot(D * v);
  const double c = v.dot(D * v);
  double discriminant = b * b - a * c;
  const double size = b * b + std::abs(a * c);
  if (discriminant < -1e-12 * size) return {};
  discriminant = std::sqrt(std::max(discriminant, 0.0));
  // a s^2 + 2 b s w + c w^2 = 0 for lambda = s u + w v, both roots without cancellation.
  const double q = -(b + std::copysign(discriminant, b));
  std::vector<Eigen::Vector3d> directions{c * u + q * v, q * u + a * v};
  if (discriminant == 0) directions.pop_back();
  return directions;
}

SE3 pose_from_ranges(std::span<const Eigen::Vector3d, 3> rays, std::span<const Eigen::Vector3d, 3> points,
                     const Eigen::Vector3d& lambda) {
  const std::array<Eigen::Vector3d, 3> in_camera{lambda(0) * rays[0], lambda(1) * rays[1],
                                                 lambda(2) * rays[2]};
  const auto frame = [](const auto& p) {  // orthonormal frame carried by the triangle
    const Eigen::Vector3d x = (p[1] - p[0]).normalized();
    const Eigen::Vector3d z = x.cross(p[2] - p[0]).normalized();
    Eigen::Matrix3d m;
    m << x, z.cross(x), z;
    return m;
  };
  const Eigen::Matrix3d rotation = frame(in_camera) * frame(points).transpose();
  const Eigen::Quaterniond q(rotation);
  const Eigen::Vector3d mean_in_camera = (in_camera[0] + in_camera[1] + in_camera[2]) / 3;
  const Eigen::Vector3d mean_in_map = (points[0] + points[1] + points[2]) / 3;
  return {q, mean_in_camera - q * mean_in_map};
}

}  // namespace

std::vector<SE3> solve_p3p(std::span<const Eigen::Vector3d, 3> rays,
                           std::span<const Eigen::Vector3d, 3> points_in_map) {
  const double area = (points_in_map[1] - points_in_map[0]).cross(points_in_map[2] - points_in_map[0]).norm();
  const RangeEquations e = range_equations(rays, points_in_map);
  const double largest = *std::max_element(e.squared_distance.begin(), e.squared_distance.end());
  if (!(area > 1e-9 * largest)) return {};

  Eigen::Matrix3d D1 = (e.m[0] * e.squared_distance[2] - e.m[2] * e.squared_distance[0]) / largest;
  Eigen::Matrix3d D2 = (e.m[1] * e.squared_distance[2] - e.m[2] * e.squared_distance[1]) / largest;
  if (std::abs(D1.determinant()) > std::abs(D2.determinant())) std::swap(D1, D2);
  const auto cubic = pencil_determinant(D1, D2);
  if (cubic[3] == 0) return {};
  const Eigen::Matrix3d degenerate = D1 + steepest_cubic_root(cubic) * D2;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(degenerate);
  const Eigen::Vector3d& values = eigen.eigenvalues();
  // The middle eigenvalue is the zero one; real planes need the outer two of opposite signs.
  if (!(values(0) < 0 && values(2) > 0)) return {};

  std::vector<SE3> poses;
  poses.reserve(4);
  const double ratio = std::sqrt(-values(0) / values(2));
  for (const double sign : {1.0, -1.0}) {
    const Eigen::Vector3d normal = eigen.eigenvectors().col(2) + sign * ratio * eigen.eigenvectors().col(0);
    for (const auto& direction : plane_conic_directions(normal, D2)) {
      if (const auto lambda = ranges_along(e, direction))
        poses.push_back(pose_from_ranges(rays, points_in_map, *lambda));
    }
  }
  return poses;
}

}  // namespace cairn
