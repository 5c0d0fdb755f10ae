// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "common/geometry/pose.h"

namespace cairn {
namespace {

constexpr double kParallax = 0.3;  // [map unit] between where the rays begin and the camera

/// Things around a camera at the origin, whose rays begin beside it.
struct Scene {
  CameraPtr camera = *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, -0.1}});
  SE3 camera_from_map;
  std::vector<PointObservation> points;
  std::vector<BearingObservation> bearings;  ///< the same things
};

/// `depth_sigma`: of the inverse depth over its value, which is off by so much.
Scene make_scene(unsigned seed, int count, double noise, double depth_sigma, double parallax = kParallax) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  Scene scene;
  const auto vector = [&] { return Eigen::Vector3d{normal(engine), normal(engine), normal(engine)}; };
  scene.camera_from_map = SE3(so3_exp(vector()), vector());
  const SE3 map_from_camera = scene.camera_from_map.inverse();
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel{639 * uniform(engine), 479 * uniform(engine)};
    const Eigen::Vector3d thing =
        map_from_camera * Eigen::Vector3d((1 + 4 * uniform(engine)) * scene.camera->unproject(pixel));
    BearingObservation b;
    b.sigma = std::pow(2.0, i % 3);
    b.origin_in_map = map_from_camera.translation() + parallax * vector();
    b.bearing_in_map = (thing - b.origin_in_map).normalized();
    const double inverse_depth = 1 / (thing - b.origin_in_map).norm();
    const double sigma = depth_sigma * inverse_depth;
    b.inverse_depth = std::max(0.0, inverse_depth + sigma * normal(engine));
    b.inverse_depth_variance = sigma * sigma;
    b.pixel = pixel + noise * b.sigma * Eigen::Vector2d{normal(engine), normal(engine)};
    scene.points.push_back({thing, b.pixel, b.sigma});
    scene.bearings.push_back(b);
  }
  return scene;
}

SE3 disturbed(const SE3& pose) {
  Vector6d xi;
  xi << 0.02, -0.02, 0.01, 0.01, 0.005, -0.01;
  return SE3::exp(xi) * pose;
}

Vector6d error_of(const Scene& scene, const SE3& found) {
  return (found * scene.camera_from_map.inverse()).log();
}

Result<PoseEstimate> solve(const Scene& scene, std::span<const PointObservation> points,
                           const PoseSupplement& supplement, const SE3& start) {
  PoseWorkspace workspace;
  PoseEstimate estimate;
  return optimize_pose(*scene.camera, start, points, supplement, {}, &workspace, &estimate).map([&] {
    return estimate;
  });
}

TEST(BearingPose, WithItsDistanceKnownABearingIsAPoint) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Scene scene = make_scene(seed, 60, 1, 0);
    const SE3 start = disturbed(scene.camera_from_map);
    const auto by_points = optimize_pose(*scene.camera, start, scene.points);
    const auto by_bearings = solve(scene, {}, {scene.bearings, {}}, start);
    ASSERT_TRUE(by_points && by_bearings) << "seed " << seed;
    EXPECT_LT((by_points->camera_from_map * by_bearings->camera_from_map.inverse()).log().norm(), 1e-9);
    EXPECT_TRUE(by_points->covariance.isApprox(by_bearings->covariance, 1e-6));
    EXPECT_EQ(by_points->inliers, by_bearings->inliers);
  }
}

TEST(BearingPose, WithoutADistanceItHoldsTheRotationAndNotMore) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Scene scene = make_scene(seed, 60, 0, 0, 0);  // rays that begin in the camera
    for (BearingObservation& b : scene.bearings) {
      b.inverse_depth = 0;
      b.inverse_depth_variance = 1;
    }
    const SE3 map_from_camera = scene.camera_from_map.inverse();
    EXPECT_FALSE(solve(scene, {}, {scene.bearings, {}}, scene.camera_from_map))
        << "nothing holds the position";
    const SE3 turned = SE3(so3_exp({0.01, -0.02, 0.02}), {0, 0, 0}) * scene.camera_from_map;
    const PositionPrior position{map_from_camera.translation(), 0.1};
    const auto found = solve(scene, {}, {scene.bearings, position}, turned);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_LT(error_of(scene, found->camera_from_map).norm(), 1e-6) << "seed " << seed;
    EXPECT_EQ((found->information.topLeftCorner<3, 3>().norm()), 0);
    EXPECT_NEAR(std::sqrt(found->covariance(0, 0)), position.sigma, 1e-9);
  }
}

/// However many: what they have in common is that nobody knows how far they are.
TEST(BearingPose, WhoseDistancesAreGuessedTheyDoNotMoveTheCamera) {
  Scene scene = make_scene(2, 200, 0, 0, 0);
  for (BearingObservation& b : scene.bearings) {
    b.inverse_depth *= 3;
    b.inverse_depth_variance = 0.25 * b.inverse_depth * b.inverse_depth;
  }
  const SE3 moved = SE3(Eigen::Quaterniond::Identity(), {0.01, 0, 0}) * scene.camera_from_map;
  const auto found = solve(scene, {}, {scene.bearings, PositionPrior{moved.center(), 1}}, moved);
  ASSERT_TRUE(found);
  EXPECT_LT((found->camera_from_map.center() - moved.center()).norm(), 1e-9);
  EXPECT_GT(found->covariance(0, 0), 0.99);
}

/// Mahalanobis distances of a 6-vector: mean 6. Points, bearings of things half known, both.
TEST(BearingPose, CovarianceDescribesTheErrors) {
  constexpr unsigned kTrials = 200;
  double by_bearings = 0;
  double by_both = 0;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const Scene scene = make_scene(seed, 200, 1.0, 0.1, 0.1);
    const auto distance = [&](std::span<const PointObservation> points) {
      const auto found =
          solve(scene, points, {std::span(scene.bearings).subspan(points.size()), {}}, scene.camera_from_map);
      EXPECT_TRUE(found);
      const Vector6d e = error_of(scene, found->camera_from_map);
      return e.dot(found->covariance.inverse() * e);
    };
    by_bearings += distance({});
    by_both += distance(std::span(scene.points).first(20));
  }
  EXPECT_GT(by_bearings / kTrials, 4.0);
  EXPECT_LT(by_bearings / kTrials, 8.0);
  EXPECT_GT(by_both / kTrials, 4.0);
  EXPECT_LT(by_both / kTrials, 8.0);
}

TEST(BearingPose, WithoutASupplementNothingChangesToTheBit) {
  const Scene scene = make_scene(3, 100, 1, 0.1);
  const SE3 start = disturbed(scene.camera_from_map);
  const auto plain = optimize_pose(*scene.camera, start, scene.points);
  const auto with_none = solve(scene, scene.points, {}, start);
  ASSERT_TRUE(plain && with_none);
  EXPECT_EQ(plain->camera_from_map.translation(), with_none->camera_from_map.translation());
  EXPECT_EQ(plain->camera_from_map.rotation().coeffs(), with_none->camera_from_map.rotation().coeffs());
  EXPECT_EQ(plain->weights, with_none->weights);
}

}  // namespace
}  // namespace cairn
