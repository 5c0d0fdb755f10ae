// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/plane.h"

#include <gtest/gtest.h>

#include <random>

namespace cairn {
namespace {

/// A tilted desk of 1 m with clutter above it, seen from `viewpoint`.
struct Desk {
  SE3 map_from_plane;
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d viewpoint;
  int on_plane = 0;
};

Desk make_desk(unsigned seed, double clutter_fraction, double noise) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> uniform(-0.5, 0.5);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Eigen::Vector3d{normal(engine), normal(engine), normal(engine)}; };
  Desk desk;
  desk.map_from_plane = SE3(so3_exp(vector()), vector());
  constexpr int kPoints = 300;
  for (int i = 0; i < kPoints; ++i) {
    const bool clutter = i < clutter_fraction * kPoints;
    const double height = clutter ? 0.3 + 0.5 * uniform(engine) : noise * normal(engine);
    desk.points.push_back(desk.map_from_plane * Eigen::Vector3d{uniform(engine), uniform(engine), height});
    desk.on_plane += clutter ? 0 : 1;
  }
  desk.viewpoint = desk.map_from_plane * Eigen::Vector3d(0.1, -0.4, 0.8);
  return desk;
}

TEST(DominantPlane, IsFoundUnderClutterAndLiesAtZ0WithTheViewerAbove) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const Desk desk = make_desk(seed, 0.4, 0.002);
    const auto fit = fit_dominant_plane(desk.points, desk.viewpoint, 0.01);
    ASSERT_TRUE(fit) << "seed " << seed;
    const SE3 found_from_true = fit->plane_from_map * desk.map_from_plane;
    EXPECT_GT((found_from_true.rotation() * Eigen::Vector3d::UnitZ()).z(), std::cos(0.005))
        << "seed " << seed;
    EXPECT_LT(std::abs(found_from_true.translation().z()), 0.003) << "seed " << seed;
    EXPECT_GT((fit->plane_from_map * desk.viewpoint).z(), 0) << "seed " << seed;
    EXPECT_GE(fit->inliers, desk.on_plane * 9 / 10) << "seed " << seed;
  }
}

TEST(DominantPlane, MeanOfTheInliersIsTheOrigin) {
  const Desk desk = make_desk(1, 0, 0.002);
  const auto fit = fit_dominant_plane(desk.points, desk.viewpoint, 0.05);
  ASSERT_TRUE(fit);
  ASSERT_EQ(fit->inliers, 300);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : desk.points) mean += fit->plane_from_map * p / 300;
  EXPECT_LT(mean.norm(), 1e-12);
}

TEST(DominantPlane, SameSeedSameBytes) {
  const Desk desk = make_desk(2, 0.4, 0.002);
  const auto first = fit_dominant_plane(desk.points, desk.viewpoint, 0.01, 100, 7);
  const auto second = fit_dominant_plane(desk.points, desk.viewpoint, 0.01, 100, 7);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->plane_from_map.rotation().coeffs(), second->plane_from_map.rotation().coeffs());
  EXPECT_EQ(first->plane_from_map.translation(), second->plane_from_map.translation());
}

TEST(DominantPlane, RefusesTooFewPointsALineAndACloud) {
  const Desk desk = make_desk(3, 0, 0);
  const auto few = fit_dominant_plane(std::span(desk.points).first(9), desk.viewpoint, 0.01);
  std::vector<Eigen::Vector3d> line;
  line.reserve(30);
  for (int i = 0; i < 30; ++i) line.emplace_back(0.1 * i, 0, 0);
  std::mt19937 engine(1);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> cloud(300);
  for (auto& p : cloud) p = {normal(engine), normal(engine), normal(engine)};
  for (const auto& fit :
       {few, fit_dominant_plane(line, {0, 0, 1}, 0.01), fit_dominant_plane(cloud, {0, 0, 9}, 0.01)}) {
    ASSERT_FALSE(fit);
    EXPECT_EQ(fit.error().code, ErrorCode::kDegenerate);
  }
}

}  // namespace
}  // namespace cairn
