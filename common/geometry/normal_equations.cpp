// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/normal_equations.h"

#include "common/base/simd.h"

namespace cairn {
namespace {

using Linearized = PoseWorkspace::Linearized;

NormalEquations sum_two(std::span<const Linearized> observations, std::span<const double> weights) {
  NormalEquations sum;
  for (size_t i = 0; i < observations.size(); ++i) {
    if (!(weights[i] > 0)) continue;
    const auto& j = observations[i].d_residual_d_xi;
    size_t k = 0;
    for (size_t row = 0; row < 6; ++row) {
      const Eigen::Array2d weighted = weights[i] * j[row];
      sum.sums[row] += weighted * observations[i].residual;
      for (size_t column = row; column < 6; ++column) sum.upper[k++] += weighted * j[column];
    }
  }
  return sum;
}

/// Two columns side by side. Those of an odd row begin with one that lies below the diagonal: it is not kept.
CAIRN_WIDE NormalEquations sum_four(std::span<const Linearized> observations,
                                    std::span<const double> weights) {
  constexpr size_t kPairs = 3;
  F64x4 upper[6][kPairs];
  F64x4 sums[kPairs];
  for (auto& row : upper) {
    for (F64x4& pair : row) pair = F64x4{};
  }
  for (F64x4& pair : sums) pair = F64x4{};
  for (size_t i = 0; i < observations.size(); ++i) {
    if (!(weights[i] > 0)) continue;
    const double* j = observations[i].d_residual_d_xi[0].data();
    const F64x4 residual = load_twice(observations[i].residual.data());
#pragma GCC unroll 3
    for (size_t p = 0; p < kPairs; ++p) {
      const F64x4 weighted = weights[i] * load_wide<F64x4>(j + 4 * p);
      const F64x4 even = lower_half_twice(weighted);
      const F64x4 odd = upper_half_twice(weighted);
      sums[p] += weighted * residual;
#pragma GCC unroll 3
      for (size_t q = p; q < kPairs; ++q) {
        const auto columns = load_wide<F64x4>(j + 4 * q);
        upper[2 * p][q] += even * columns;
        upper[2 * p + 1][q] += odd * columns;
      }
    }
  }
  std::array<std::array<double, 12>, 7> sums_of_rows;  // x and y of six columns; last, those of the residual
  for (size_t p = 0; p < kPairs; ++p) {
    for (size_t row = 0; row < 6; ++row) store_lanes(&sums_of_rows[row][4 * p], upper[row][p]);
    store_lanes(&sums_of_rows[6][4 * p], sums[p]);
  }
  NormalEquations sum;
  size_t k = 0;
  for (size_t row = 0; row < 6; ++row) {
    sum.sums[row] = {sums_of_rows[6][2 * row], sums_of_rows[6][2 * row + 1]};
    for (size_t column = row; column < 6; ++column)
      sum.upper[k++] = {sums_of_rows[row][2 * column], sums_of_rows[row][2 * column + 1]};
  }
  return sum;
}

}  // namespace

NormalEquations::NormalEquations() {
  upper.fill(Eigen::Array2d::Zero());
  sums.fill(Eigen::Array2d::Zero());
}

Vector6d NormalEquations::gradient() const {
  Vector6d g;
  for (int i = 0; i < 6; ++i) g[i] = sums[static_cast<size_t>(i)].sum();
  return g;
}

Matrix6d NormalEquations::information() const {
  Matrix6d m;
  size_t k = 0;
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) m(i, j) = m(j, i) = upper[k++].sum();
  }
  return m;
}

SumLanes best_sum_lanes() {
  static const SumLanes best = takes_wide(best_simd()) ? SumLanes::kFour : SumLanes::kTwo;
  return best;
}

NormalEquations sum_up(std::span<const Linearized> observations, std::span<const double> weights,
                       SumLanes lanes) {
  return lanes == SumLanes::kFour ? sum_four(observations, weights) : sum_two(observations, weights);
}

}  // namespace cairn
