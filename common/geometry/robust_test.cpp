// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/robust.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace cairn {
namespace {

TEST(Tukey, WeightIsTwiceTheSlopeOfTheCost) {
  constexpr double kCutoff = 7.0;
  constexpr double kStep = 1e-6;
  for (double s = 0.05; s < 10; s += 0.1) {
    const double slope = (tukey_cost(s + kStep, kCutoff) - tukey_cost(s - kStep, kCutoff)) / (2 * kStep);
    EXPECT_NEAR(slope, 0.5 * tukey_weight(s, kCutoff), 1e-8) << s;
  }
}

TEST(Tukey, CostGrowsFromZeroToASixthOfTheCutoff) {
  constexpr double kCutoff = 7.0;
  EXPECT_EQ(tukey_cost(0, kCutoff), 0);
  for (double s = 0; s < 10; s += 0.25) EXPECT_LE(tukey_cost(s, kCutoff), tukey_cost(s + 0.25, kCutoff));
  EXPECT_DOUBLE_EQ(tukey_cost(1e9, kCutoff), kCutoff / 6);
}

TEST(Tukey, ZeroCutoffRejectsAllWithoutDividingByIt) {
  EXPECT_EQ(tukey_weight(0, 0), 0);
  EXPECT_EQ(tukey_cost(0, 0), 0);
}

TEST(TukeyCutoff, OfNormalResidualsIsThatOfTheirSigma) {
  std::mt19937 engine(1);
  std::normal_distribution<double> normal(0, 3.0);
  std::vector<double> squared(20001);
  for (double& s : squared) s = std::pow(normal(engine), 2);
  EXPECT_NEAR(std::sqrt(tukey_squared_cutoff(squared)), 4.6851 * 3.0, 0.3);
}

TEST(TukeyCutoff, DoesNotFollowAMinorityOfOutliers) {
  std::vector<double> clean(101, 1.0);
  std::vector<double> spoiled = clean;
  for (size_t i = 0; i < 45; ++i) spoiled[i] = 1e9;
  EXPECT_DOUBLE_EQ(tukey_squared_cutoff(clean), tukey_squared_cutoff(spoiled));
}

TEST(TukeyCutoff, IsFiniteAndPositiveForEverySmallNumber) {
  std::vector<double> none;
  EXPECT_EQ(tukey_squared_cutoff(none), 0);
  double previous = std::numeric_limits<double>::infinity();
  for (size_t n = 1; n < 20; ++n) {
    std::vector<double> squared(n, 2.0);
    const double cutoff = tukey_squared_cutoff(squared);
    EXPECT_TRUE(std::isfinite(cutoff)) << n;
    EXPECT_GT(cutoff, 2.0 * std::pow(4.6851 * 1.4826, 2)) << n;
    EXPECT_LE(cutoff, previous) << n;
    previous = cutoff;
  }
}

}  // namespace
}  // namespace cairn
