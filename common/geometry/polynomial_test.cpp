// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/polynomial.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace cairn {
namespace {

/// Coefficients of scale * product of (x - root).
std::vector<double> with_roots(const std::vector<double>& roots, double scale) {
  std::vector<double> coefficients = {scale};
  for (const double root : roots) {
    std::vector<double> next(coefficients.size() + 1, 0.0);
    for (size_t i = 0; i < coefficients.size(); ++i) {
      next[i + 1] += coefficients[i];
      next[i] -= root * coefficients[i];
    }
    coefficients = next;
  }
  return coefficients;
}

TEST(SignChanges, FindTheRootsThePolynomialWasMadeOf) {
  constexpr unsigned kSeed = 5;
  std::mt19937 random(kSeed);
  for (int trial = 0; trial < 500; ++trial) {
    std::vector<double> roots;
    double at = -3;
    for (int i = 0; i < 1 + trial % 5; ++i) {
      at += std::uniform_real_distribution<double>(0.1, 1.5)(random);
      roots.push_back(at);
    }
    const auto found = sign_changes(with_roots(roots, trial % 2 == 0 ? 2.5 : -0.3), -3, 5);
    std::erase_if(roots, [](double root) { return root > 5; });
    ASSERT_EQ(found.size(), roots.size()) << "seed " << kSeed << ", trial " << trial;
    for (size_t i = 0; i < roots.size(); ++i) EXPECT_NEAR(found[i], roots[i], 1e-9) << "seed " << kSeed;
  }
}

TEST(SignChanges, DoNotSeeWhatOnlyTouchesOrLiesOutside) {
  EXPECT_TRUE(sign_changes(with_roots({0.5}, 1), 1, 2).empty());
  EXPECT_TRUE(sign_changes(std::vector<double>{1, 0, 1}, -9, 9).empty());
  EXPECT_TRUE(sign_changes(std::vector<double>{3}, -1, 1).empty());
  EXPECT_TRUE(sign_changes(std::vector<double>{}, -1, 1).empty());
  EXPECT_FALSE(first_sign_change(std::vector<double>{1, 0, 0, 0}, 0, 10));
  EXPECT_NEAR(*first_sign_change(with_roots({2, 1, 4}, 1), 0, 10), 1, 1e-12);
}

}  // namespace
}  // namespace cairn
