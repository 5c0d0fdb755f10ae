// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/view_span.h"

#include <gtest/gtest.h>

#include <vector>

namespace cairn {
namespace {

Eigen::Vector3d sideways(double x) {
  return {x, 0, 0};
}

TEST(ViewSpan, HalfAsMuchAgainWidensAndLessDoesNot) {
  const std::vector<Eigen::Vector3d> pair{sideways(0), sideways(0.02)};
  EXPECT_FALSE(widens_young_map(pair, sideways(0.029), 1));
  EXPECT_TRUE(widens_young_map(pair, sideways(0.031), 1));
  EXPECT_TRUE(widens_young_map(pair, sideways(-0.011), 1));
  EXPECT_FALSE(widens_young_map(pair, sideways(0.01), 1));
  EXPECT_TRUE(widens_young_map(pair, sideways(0.02) + Eigen::Vector3d(0, 0, 0.03), 1));
}

TEST(ViewSpan, AHandfulOfViewsLeadsToATenthOfTheDepth) {
  std::vector<Eigen::Vector3d> views{sideways(0), sideways(0.005)};
  for (double x = 0.005; x < 1; x += 0.0005) {
    if (widens_young_map(views, sideways(x), 1)) views.push_back(sideways(x));
  }
  EXPECT_GE(views.back().x(), 0.1);
  EXPECT_LT(views.back().x(), 0.16);
  EXPECT_LT(views.size(), 12U);
}

TEST(ViewSpan, DoesNotDependOnTheUnit) {
  for (const double unit : {0.01, 1.0, 50.0}) {
    const std::vector<Eigen::Vector3d> pair{sideways(0), sideways(0.02 * unit)};
    EXPECT_TRUE(widens_young_map(pair, sideways(0.04 * unit), unit));
    EXPECT_FALSE(widens_young_map(pair, sideways(0.025 * unit), unit));
  }
}

TEST(ViewSpan, AMapThatSpansATenthIsNotYoung) {
  const std::vector<Eigen::Vector3d> pair{sideways(0), sideways(0.11)};
  EXPECT_FALSE(widens_young_map(pair, sideways(1), 1));
}

TEST(ViewSpan, NeitherIsOneOfASingleView) {
  const std::vector<Eigen::Vector3d> single{sideways(0)};
  EXPECT_FALSE(widens_young_map(single, sideways(0.01), 1));
  EXPECT_FALSE(widens_young_map({}, sideways(0.01), 1));
}

TEST(ViewSpan, NeitherIsOneOfManyViews) {
  const std::vector<Eigen::Vector3d> many(kMostYoungViews + 1, sideways(0));
  EXPECT_FALSE(widens_young_map(many, sideways(1), 100));
}

}  // namespace
}  // namespace cairn
