// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/affine_map.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace cairn {
namespace {

class AffineMap : public ::testing::TestWithParam<unsigned> {
 protected:
  AffineMap() : random_(GetParam()) {
    linear_ << 1 + uniform(0.3), uniform(0.3), uniform(0.3), 1 + uniform(0.3);
    const Eigen::Vector2d shift(uniform(50), uniform(50));
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector2d a(uniform(320), uniform(240));
      matches_.push_back({a, linear_ * a + shift});
    }
  }
  double uniform(double limit) { return std::uniform_real_distribution<double>(-limit, limit)(random_); }

  std::mt19937 random_;
  Eigen::Matrix2d linear_;
  std::vector<PixelMatch> matches_;
};

TEST_P(AffineMap, IsExactWithoutNoise) {
  EXPECT_LT((fit_affine_map(matches_) - linear_).norm(), 1e-9);
}

TEST_P(AffineMap, AFifthOfTheMatchesAstrayTogetherChangeLittle) {
  for (size_t i = 0; i < matches_.size(); i += 5) matches_[i].b += Eigen::Vector2d(15, -10);
  for (PixelMatch& m : matches_) m.b += Eigen::Vector2d(uniform(0.5), uniform(0.5));
  EXPECT_LT((fit_affine_map(matches_) - linear_).norm(), 0.01);
}

TEST_P(AffineMap, WhatDoesNotDetermineItGivesTheIdentity) {
  EXPECT_EQ(fit_affine_map({}), Eigen::Matrix2d::Identity());
  for (PixelMatch& m : matches_) m.a.y() = 0.3 * m.a.x() + 7;
  EXPECT_EQ(fit_affine_map(matches_), Eigen::Matrix2d::Identity());
}

INSTANTIATE_TEST_SUITE_P(Seeds, AffineMap, ::testing::Range(1U, 6U));

}  // namespace
}  // namespace cairn
