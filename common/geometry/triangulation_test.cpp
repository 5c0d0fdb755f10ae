// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/triangulation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace cairn {
namespace {

class Scenes : public ::testing::Test {
 protected:
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  Eigen::Vector3d noise(double sigma) {
    std::normal_distribution<double> normal(0, sigma);
    return {normal(engine_), normal(engine_), normal(engine_)};
  }
  Eigen::Vector3d point() { return {uniform(-1, 1), uniform(-1, 1), uniform(1, 6)}; }
  SE3 b_from_a() { return {so3_exp(noise(0.1)), noise(0.3)}; }

  std::mt19937 engine_{1};
};

double squared_sine(const Eigen::Vector3d& unit, const Eigen::Vector3d& v) {
  return unit.cross(v.normalized()).squaredNorm();
}

using Triangulation = Scenes;

TEST_F(Triangulation, IsExactWithoutNoise) {
  for (int i = 0; i < 500; ++i) {
    const SE3 T = b_from_a();
    const Eigen::Vector3d p = point();
    if (parallax(p, Eigen::Vector3d::Zero(), T.center()) < 0.01) continue;
    const auto found = triangulate(T, p.normalized(), (T * p).normalized());
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_LT((*found - p).norm(), 1e-9);
  }
}

TEST_F(Triangulation, IsAMinimumOfTheAngularErrorUnderNoise) {
  for (int i = 0; i < 300; ++i) {
    const SE3 T = b_from_a();
    const Eigen::Vector3d p = point();
    if (parallax(p, Eigen::Vector3d::Zero(), T.center()) < 0.05) continue;
    const Eigen::Vector3d ray_a = (p.normalized() + noise(0.002)).normalized();
    const Eigen::Vector3d ray_b = ((T * p).normalized() + noise(0.002)).normalized();
    const auto found = triangulate(T, ray_a, ray_b);
    ASSERT_TRUE(found) << found.error().message;
    const auto cost = [&](const Eigen::Vector3d& x) {
      return squared_sine(ray_a, x) + squared_sine(ray_b, T * x);
    };
    for (int k = 0; k < 3; ++k) {
      for (const double step : {-1e-4, 1e-4}) {
        EXPECT_GE(cost(*found + step * Eigen::Vector3d::Unit(k)), cost(*found) * (1 - 1e-9)) << i;
      }
    }
  }
}

TEST_F(Triangulation, RefusesPointsBehindAndParallelRays) {
  const SE3 b_from_a(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  const Eigen::Vector3d ahead = Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d diverging = Eigen::Vector3d(0.2, 0, 1).normalized();
  for (const auto& [a, b] : {std::pair(ahead, ahead), std::pair(ahead, diverging)}) {
    const auto found = triangulate(b_from_a, a, b);
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);
  }
  EXPECT_FALSE(triangulate(SE3(), ahead, diverging));
}

TEST(Parallax, IsTheAngleAtThePoint) {
  EXPECT_NEAR(parallax({0, 0, 1}, {1, 0, 0}, {-1, 0, 0}), 2 * std::atan(1.0), 1e-15);
  EXPECT_NEAR(parallax({0, 0, 1}, {0, 0, 0}, {1e-9, 0, 0}), 1e-9, 1e-20);
  EXPECT_EQ(parallax({0, 0, 1}, {0, 0, 0}, {0, 0, -5}), 0);
}

}  // namespace
}  // namespace cairn
