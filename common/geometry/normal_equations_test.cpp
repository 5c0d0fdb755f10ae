// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/normal_equations.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "common/base/simd.h"

namespace cairn {
namespace {

using Linearized = PoseWorkspace::Linearized;

std::vector<Linearized> made_up(size_t count) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> value(-100, 100);
  std::vector<Linearized> observations(count);
  for (Linearized& o : observations) {
    o.residual = {value(rng), value(rng)};
    for (Eigen::Array2d& column : o.d_residual_d_xi) column = {value(rng), value(rng)};
  }
  return observations;
}

TEST(NormalEquationsTest, AreTheWeightedSumsOfTheProductsOfTheJacobians) {
  const auto observations = made_up(40);
  std::vector<double> weights(observations.size());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<double>(i % 4);
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  for (size_t i = 0; i < observations.size(); ++i) {
    Eigen::Matrix<double, 2, 6> j;
    for (int k = 0; k < 6; ++k) j.col(k) = observations[i].d_residual_d_xi[static_cast<size_t>(k)].matrix();
    information += weights[i] * j.transpose() * j;
    gradient += weights[i] * j.transpose() * observations[i].residual.matrix();
  }
  const NormalEquations sum = sum_up(observations, weights);
  EXPECT_TRUE(sum.information().isApprox(information, 1e-12));
  EXPECT_TRUE(sum.gradient().isApprox(gradient, 1e-12));
}

TEST(NormalEquationsTest, WhatHasNoWeightIsLeftOutWhateverItIs) {
  auto observations = made_up(5);
  std::vector<double> weights = {1, 2, 0, 1, 1};
  for (Eigen::Array2d& column : observations[2].d_residual_d_xi)
    column.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(sum_up(observations, weights).information().allFinite());
}

TEST(NormalEquationsTest, FourLanesGiveTheSameBytesAsTwo) {
  if (!has_wide()) GTEST_SKIP() << "this machine has no wide vectors";
  const auto observations = made_up(333);
  std::vector<double> weights(observations.size());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = i % 5 == 0 ? 0 : 1 / (1 + static_cast<double>(i));
  const NormalEquations two = sum_up(observations, weights, SumLanes::kTwo);
  const NormalEquations four = sum_up(observations, weights, SumLanes::kFour);
  EXPECT_EQ(std::memcmp(two.upper.data(), four.upper.data(), sizeof two.upper), 0);
  EXPECT_EQ(std::memcmp(two.sums.data(), four.sums.data(), sizeof two.sums), 0);
}

}  // namespace
}  // namespace cairn
