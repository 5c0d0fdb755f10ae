// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/truth.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int64_t kMs = 1'000'000;

Truth rows(std::initializer_list<std::pair<int64_t, double>> places) {
  Trajectory trajectory;
  trajectory.segments.emplace_back();
  for (const auto& [ms, x] : places) {
    trajectory.segments.back().poses.push_back(
        {Timestamp{ms * kMs}, SE3(so3_exp({0, 0, x}), Eigen::Vector3d(x, 0, 0))});
  }
  return Truth(trajectory);
}

TEST(Truth, ARowBelongsToTheFrameNearIt) {
  const Truth truth = rows({{1000, 0.1}, {1033, 0.2}});
  ASSERT_NE(truth.at(Timestamp{1005 * kMs}), nullptr);
  EXPECT_DOUBLE_EQ(truth.at(Timestamp{1005 * kMs})->translation().x(), 0.1);
  EXPECT_DOUBLE_EQ(truth.at(Timestamp{1028 * kMs})->translation().x(), 0.2);
  EXPECT_EQ(truth.at(Timestamp{1060 * kMs}), nullptr);
  EXPECT_EQ(Truth().at(Timestamp{0}), nullptr);
}

TEST(Truth, BetweenRowsNotFarApartItIsInterpolated) {
  const Truth truth = rows({{1000, 0.1}, {1100, 0.3}, {2000, 0.9}});
  const auto halfway = truth.interpolated(Timestamp{1050 * kMs});
  ASSERT_TRUE(halfway);
  EXPECT_NEAR(halfway->translation().x(), 0.2, 1e-12);
  EXPECT_NEAR(so3_log(halfway->rotation()).z(), 0.2, 1e-12);
  EXPECT_FALSE(truth.interpolated(Timestamp{1500 * kMs})) << "far apart";
  EXPECT_FALSE(truth.interpolated(Timestamp{900 * kMs})) << "before the first";
  EXPECT_FALSE(truth.interpolated(Timestamp{2100 * kMs})) << "after the last";
}

/// A map in another frame and unit, and poses in it: the offset is what was put there, in the truth's unit.
TEST(Truth, AnOffsetIsInTheUnitOfTheTruth) {
  const Truth truth = rows({{0, 0.1}, {1000, 0.5}});
  const Similarity3 truth_from_map(2.0, Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY())),
                                   Eigen::Vector3d(1, 2, 3));
  const SE3& exact = *truth.at(Timestamp{0});
  const SE3 same = truth_from_map.inverse().transform_camera(exact.inverse());
  EXPECT_NEAR(compare(truth_from_map, same, exact).metres, 0, 1e-12);
  EXPECT_NEAR(compare(truth_from_map, same, exact).degrees, 0, 1e-5);
  const SE3 aside = SE3(so3_exp({0, 0.1, 0}), Eigen::Vector3d(0.01, 0, 0)) * same;  // [map unit]
  EXPECT_NEAR(compare(truth_from_map, aside, exact).metres, 0.02, 1e-9);
  EXPECT_NEAR(compare(truth_from_map, aside, exact).degrees, 0.1 * 180 / M_PI, 1e-9);
  EXPECT_FALSE(compare(truth_from_map, aside, exact).is_right(0.05)) << "5.7 degrees";
}

}  // namespace
}  // namespace cairn
