// SPDX-License-Identifier: Apache-2.0
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

/// Newton on the three range equations from a good start: it squares the error, so what is left after a small
/// step is rounding. Nothing: there is no root, planes and conic but for rounding do not meet.
std::optional<Eigen::Vector3d> polish(const RangeEquations& e, Eigen::Vector3d lambda) {
  constexpr int kMostSteps = 10;
  constexpr double kSmallStep = 1e-8;
  for (int iteration = 0; iteration < kMostSteps; ++iteration) {
    Eigen::Matrix3d jacobian;
    Eigen::Vector3d residual;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d m_lambda = e.m[static_cast<size_t>(k)] * lambda;
      residual(k) = lambda.dot(m_lambda) - e.squared_distance[static_cast<size_t>(k)];
      jacobian.row(k) = 2 * m_lambda.transpose();
    }
    const Eigen::Vector3d step = jacobian.inverse() * residual;
    lambda -= step;
    if (step.squaredNorm() < kSmallStep * kSmallStep * lambda.squaredNorm()) return lambda;
  }
  return std::nullopt;
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
  const auto lambda = polish(e, std::sqrt(measured / model) * direction);
  return lambda && lambda->minCoeff() > 0 ? lambda : std::nullopt;
}

/// A symmetric matrix of rank two: its eigenvalues of either sign, and unit eigenvectors.
struct OppositeEigen {
  double negative, positive;
  Eigen::Vector3d of_negative, of_positive;
};

/// The eigenvector of a simple eigenvalue: what is normal to the rows of what it makes singular, by the two
/// that tell most.
Eigen::Vector3d eigenvector(const Eigen::Matrix3d& symmetric, double eigenvalue) {
  const Eigen::Matrix3d m = symmetric - eigenvalue * Eigen::Matrix3d::Identity();
  const std::array<Eigen::Vector3d, 3> normals{m.col(0).cross(m.col(1)), m.col(0).cross(m.col(2)),
                                               m.col(1).cross(m.col(2))};
  return std::max_element(normals.begin(), normals.end(),
                          [](const auto& u, const auto& v) { return u.squaredNorm() < v.squaredNorm(); })
      ->normalized();
}

/// The eigenvalues of opposite signs and their eigenvectors, of a matrix whose third eigenvalue is zero,
/// which is taken for granted. Nothing: the two are not of opposite signs.
std::optional<OppositeEigen> opposite_eigen(const Eigen::Matrix3d& m) {
  const double minors = m(0, 0) * m(1, 1) - m(0, 1) * m(0, 1) + m(0, 0) * m(2, 2) - m(0, 2) * m(0, 2) +
                        m(1, 1) * m(2, 2) - m(1, 2) * m(1, 2);
  if (!(minors < 0)) return std::nullopt;
  const double half_trace = m.trace() / 2;
  const double larger = half_trace + std::copysign(std::sqrt(half_trace * half_trace - minors), half_trace);
  const double smaller = minors / larger;
  const double negative = std::min(larger, smaller);
  const double positive = std::max(larger, smaller);
  return OppositeEigen{negative, positive, eigenvector(m, negative), eigenvector(m, positive)};
}

/// Directions where the plane normal^T lambda = 0 meets the conic lambda^T D lambda = 0.
struct Directions {
  std::array<Eigen::Vector3d, 2> of;
  size_t count = 0;
};
Directions plane_conic_directions(const Eigen::Vector3d& normal, const Eigen::Matrix3d& D) {
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
  return {{c * u + q * v, q * u + a * v}, discriminant == 0 ? size_t{1} : size_t{2}};
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
  // Real planes need eigenvalues of opposite signs.
  const auto eigen = opposite_eigen(degenerate);
  if (!eigen) return {};

  std::vector<SE3> poses;
  poses.reserve(4);
  const double ratio = std::sqrt(-eigen->negative / eigen->positive);
  for (const double sign : {1.0, -1.0}) {
    const Eigen::Vector3d normal = eigen->of_positive + sign * ratio * eigen->of_negative;
    const Directions directions = plane_conic_directions(normal, D2);
    for (size_t i = 0; i < directions.count; ++i) {
      if (const auto lambda = ranges_along(e, directions.of[i]))
        poses.push_back(pose_from_ranges(rays, points_in_map, *lambda));
    }
  }
  return poses;
}

}  // namespace cairn
