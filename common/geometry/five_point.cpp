// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

#include "common/geometry/epipolar.h"

// Stewenius, Engels and Nister, "Recent developments on direct relative orientation" (ISPRS J. 2006): E = x X
// + y Y + z Z
// + W over the null space of the five epipolar constraints; det E = 0 and 2 E E^T E = trace(E E^T) E are ten
// cubics in (x, y, z); eliminated to the ten cubic monomials they give the action matrix of multiplication by
// x.
namespace cairn {
namespace {

// Monomials, by exponents of (x, y, z): ten cubic ones, then the ten of degree two and less, the basis of the
// quotient.
constexpr int kMonomials = 20;
constexpr std::array<std::array<int, 3>, kMonomials> kExponents{
    {{3, 0, 0}, {2, 1, 0}, {1, 2, 0}, {0, 3, 0}, {2, 0, 1}, {1, 1, 1}, {0, 2, 1},
     {1, 0, 2}, {0, 1, 2}, {0, 0, 3}, {2, 0, 0}, {1, 1, 0}, {0, 2, 0}, {1, 0, 1},
     {0, 1, 1}, {0, 0, 2}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};
constexpr int kFirstLinear = 16;     // x, y, z, 1
constexpr int kFirstQuadratic = 10;  // x^2 ... 1

constexpr size_t product_index(size_t i, size_t j) {
  for (size_t k = 0; k < kMonomials; ++k) {
    bool equal = true;
    for (size_t d = 0; d < 3; ++d) equal = equal && kExponents[k][d] == kExponents[i][d] + kExponents[j][d];
    if (equal) return k;
  }
  return kMonomials;
}

/// table[i][j]: position of the product of monomial First1 + i and First2 + j.
template <size_t First1, size_t First2>
constexpr auto product_table() {
  std::array<std::array<size_t, kMonomials - First2>, kMonomials - First1> table{};
  for (size_t i = First1; i < kMonomials; ++i) {
    for (size_t j = First2; j < kMonomials; ++j) table[i - First1][j - First2] = product_index(i, j);
  }
  return table;
}

using Linear = std::array<double, 4>;      // x, y, z, 1
using Quadratic = std::array<double, 10>;  // kExponents from kFirstQuadratic on
using Cubic = std::array<double, 20>;

constexpr auto kLinearTimesLinear = product_table<kFirstLinear, kFirstLinear>();
constexpr auto kQuadraticTimesLinear = product_table<kFirstQuadratic, kFirstLinear>();

void add_product(const Linear& p, const Linear& q, double factor, Quadratic& sum) {
  for (size_t i = 0; i < 4; ++i) {
    for (size_t j = 0; j < 4; ++j) sum[kLinearTimesLinear[i][j] - kFirstQuadratic] += factor * p[i] * q[j];
  }
}

void add_product(const Quadratic& p, const Linear& q, Cubic& sum) {
  for (size_t i = 0; i < 10; ++i) {
    for (size_t j = 0; j < 4; ++j) sum[kQuadraticTimesLinear[i][j]] += p[i] * q[j];
  }
}

using LinearMatrix = std::array<std::array<Linear, 3>, 3>;
using NullSpace = Eigen::Matrix<double, 9, 4>;
using Constraints = Eigen::Matrix<double, 10, kMonomials>;

/// Row-major entries of the four matrices that span the solutions of the five epipolar constraints.
NullSpace null_space(const std::array<NormalizedMatch, 5>& sample) {
  Eigen::Matrix<double, 9, 5> constraints;
  for (int k = 0; k < 5; ++k) {
    const NormalizedMatch& m = sample[static_cast<size_t>(k)];
    constraints.col(k) << m.b.x() * m.a, m.b.y() * m.a, m.b.z() * m.a;
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, 5>> qr(constraints);
  NullSpace last = NullSpace::Zero();
  last.bottomRows<4>().setIdentity();
  return qr.householderQ() * last;
}

Constraints expand_constraints(const LinearMatrix& E) {
  Constraints rows;
  const auto put = [&](int row, const Cubic& c) {
    for (int k = 0; k < kMonomials; ++k) rows(row, k) = c[static_cast<size_t>(k)];
  };
  std::array<std::array<Quadratic, 3>, 3> m{};  // 2 E E^T - trace(E E^T) I
  Quadratic trace{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = i; j < 3; ++j) {
      for (size_t k = 0; k < 3; ++k) add_product(E[i][k], E[j][k], 2, m[i][j]);
      m[j][i] = m[i][j];
    }
    for (size_t q = 0; q < 10; ++q) trace[q] += 0.5 * m[i][i][q];
  }
  for (size_t i = 0; i < 3; ++i) {
    for (size_t q = 0; q < 10; ++q) m[i][i][q] -= trace[q];
  }
  int row = 0;
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      Cubic c{};
      for (size_t k = 0; k < 3; ++k) add_product(m[i][k], E[k][j], c);
      put(row++, c);
    }
  }
  Cubic determinant{};
  for (size_t j = 0; j < 3; ++j) {
    Quadratic minor{};
    add_product(E[1][(j + 1) % 3], E[2][(j + 2) % 3], 1, minor);
    add_product(E[1][(j + 2) % 3], E[2][(j + 1) % 3], -1, minor);
    add_product(minor, E[0][j], determinant);
  }
  put(row, determinant);
  return rows;
}

/// Multiplication by x of the basis monomials modulo the constraints.
Eigen::Matrix<double, 10, 10> action_matrix(const Constraints& constraints) {
  const Eigen::Matrix<double, 10, 10> reduced =
      constraints.leftCols<10>().partialPivLu().solve(constraints.rightCols<10>());
  Eigen::Matrix<double, 10, 10> action = Eigen::Matrix<double, 10, 10>::Zero();
  for (int i = 0; i < 10; ++i) {
    // x is monomial 16; the product is cubic (eliminated) or again in the basis.
    const auto product =
        static_cast<int>(product_index(static_cast<size_t>(kFirstQuadratic + i), kFirstLinear));
    if (product < kFirstQuadratic) {
      action.row(i) = -reduced.row(product);
    } else {
      action(i, product - kFirstQuadratic) = 1;
    }
  }
  return action;
}

}  // namespace

void solve_five_point(const std::array<NormalizedMatch, 5>& sample, std::vector<Eigen::Matrix3d>& out) {
  const NullSpace basis = null_space(sample);
  LinearMatrix E;
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      for (size_t k = 0; k < 4; ++k) E[i][j][k] = basis(static_cast<int>(3 * i + j), static_cast<int>(k));
    }
  }
  const auto action = action_matrix(expand_constraints(E));
  if (!action.allFinite()) return;
  const Eigen::EigenSolver<Eigen::Matrix<double, 10, 10>> solver(action);
  if (solver.info() != Eigen::Success) return;
  for (int k = 0; k < 10; ++k) {
    if (solver.eigenvalues()(k).imag() != 0) continue;
    const Eigen::Vector4d xyz1 = solver.eigenvectors().col(k).tail<4>().real();
    const Eigen::Matrix<double, 9, 1> e = (basis * xyz1).normalized();
    if (!e.allFinite()) continue;
    out.emplace_back(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(e.data()));
  }
}

}  // namespace cairn
