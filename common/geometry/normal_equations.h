// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "common/geometry/pose.h"

namespace cairn {

/// Upper triangle, row by row, of sum w J^T J; and sum w J^T r. The rows of x and of y are summed side by
/// side: two lanes of a register. Private to common/geometry and its tests.
struct NormalEquations {
  std::array<Eigen::Array2d, 21> upper;
  std::array<Eigen::Array2d, 6> sums;

  NormalEquations();
  [[nodiscard]] Vector6d gradient() const;
  [[nodiscard]] Matrix6d information() const;
};

/// How many lanes of a register the sums are made with; both give the same bytes.
enum class SumLanes { kTwo, kFour };

/// The most lanes that this machine has (four: AVX2, or arm64).
[[nodiscard]] SumLanes best_sum_lanes();

/// The normal equations of the observations whose weight is above 0. There are as many weights as
/// observations.
[[nodiscard]] NormalEquations sum_up(std::span<const PoseWorkspace::Linearized> observations,
                                     std::span<const double> weights, SumLanes lanes = best_sum_lanes());

}  // namespace cairn
