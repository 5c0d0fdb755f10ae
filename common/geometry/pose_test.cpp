// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/pose.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

namespace cairn {
namespace {

struct Scene {
  CameraPtr camera;
  SE3 camera_from_map;
  std::vector<PointObservation> observations;
};

/// Points in the view of a EuRoC camera; the first `outlier_fraction` of them at random pixels.
Scene make_scene(unsigned seed, int count, double noise, double outlier_fraction) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  Scene scene;
  scene.camera =
      make_camera({CameraModel::kPinholeRadtan,
                   752,
                   480,
                   {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}})
          .value();
  const auto vector = [&] { return Eigen::Vector3d{normal(engine), normal(engine), normal(engine)}; };
  scene.camera_from_map = SE3(so3_exp(vector()), vector());
  const SE3 map_from_camera = scene.camera_from_map.inverse();
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel{751 * uniform(engine), 479 * uniform(engine)};
    PointObservation o;
    o.sigma = std::pow(2.0, i % 4);
    o.point_in_map =
        map_from_camera * Eigen::Vector3d((1 + 4 * uniform(engine)) * scene.camera->unproject(pixel));
    o.pixel =
        i < outlier_fraction * count
            ? Eigen::Vector2d{751 * uniform(engine), 479 * uniform(engine)}
            : Eigen::Vector2d(pixel + noise * o.sigma * Eigen::Vector2d{normal(engine), normal(engine)});
    scene.observations.push_back(o);
  }
  return scene;
}

/// Left tangent (translation, rotation) from the true to the found pose.
Vector6d error_of(const Scene& scene, const SE3& found) {
  return (found * scene.camera_from_map.inverse()).log();
}

SE3 disturbed(const SE3& pose, double translation, double rotation) {
  Vector6d xi;
  xi << translation, -translation, 0.5 * translation, rotation, 0.5 * rotation, -rotation;
  return SE3::exp(xi) * pose;
}

TEST(OptimizePose, IsExactWithoutNoise) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Scene scene = make_scene(seed, 50, 0, 0);
    const auto found =
        optimize_pose(*scene.camera, disturbed(scene.camera_from_map, 0.05, 0.03), scene.observations);
    ASSERT_TRUE(found) << "seed " << seed << ": " << found.error().message;
    EXPECT_LT(error_of(scene, found->camera_from_map).norm(), 1e-10) << "seed " << seed;
    EXPECT_EQ(found->inliers, 50);
    EXPECT_LT(found->rms, 1e-7);
  }
}

TEST(OptimizePose, IsNotMovedByOutliersAndTellsThem) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Scene scene = make_scene(seed, 300, 0.5, 0.3);
    const auto found =
        optimize_pose(*scene.camera, disturbed(scene.camera_from_map, 0.02, 0.01), scene.observations);
    ASSERT_TRUE(found) << "seed " << seed << ": " << found.error().message;
    EXPECT_LT(error_of(scene, found->camera_from_map).tail<3>().norm(), 0.002) << "seed " << seed;
    EXPECT_LT(error_of(scene, found->camera_from_map).head<3>().norm(), 0.01) << "seed " << seed;
    int kept = 0;
    for (size_t i = 90; i < 300; ++i) kept += found->weights[i] > 0 ? 1 : 0;
    EXPECT_GE(kept, 205) << "seed " << seed;
    EXPECT_LE(found->inliers - kept, 5) << "seed " << seed;
  }
}

TEST(OptimizePose, CovarianceDescribesTheErrors) {
  // Mahalanobis distances of a 6-vector: mean 6. Sigma is as stated (noise 1), Tukey's efficiency 95 %.
  double sum = 0;
  constexpr unsigned kTrials = 200;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const Scene scene = make_scene(seed, 200, 1.0, 0);
    const auto found = optimize_pose(*scene.camera, scene.camera_from_map, scene.observations);
    ASSERT_TRUE(found);
    const Vector6d e = error_of(scene, found->camera_from_map);
    sum += e.dot(found->covariance.inverse() * e);
  }
  EXPECT_GT(sum / kTrials, 4.0);
  EXPECT_LT(sum / kTrials, 8.0);
}

TEST(OptimizePose, PointsBehindTheCameraWeighNothing) {
  Scene scene = make_scene(3, 60, 0, 0);
  scene.observations[5].point_in_map = scene.camera_from_map.inverse() * Eigen::Vector3d(0, 0, -2);
  const auto found = optimize_pose(*scene.camera, scene.camera_from_map, scene.observations);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->weights[5], 0);
  EXPECT_EQ(found->inliers, 59);
}

TEST(OptimizePose, APriorOnlySlowsTheSteps) {
  const Scene scene = make_scene(4, 100, 0, 0);
  const SE3 start = disturbed(scene.camera_from_map, 0.02, 0.01);
  PoseOptions options;
  options.prior = 100;
  options.iterations = 30;
  const auto found = optimize_pose(*scene.camera, start, scene.observations, options);
  ASSERT_TRUE(found);
  EXPECT_LT(error_of(scene, found->camera_from_map).norm(), 1e-8);
}

TEST(OptimizePose, RefusesWhatDoesNotDetermineAPose) {
  const Scene scene = make_scene(5, 20, 0, 0);
  const auto few =
      optimize_pose(*scene.camera, scene.camera_from_map, std::span(scene.observations).first(3));
  const std::vector<PointObservation> same(20, scene.observations[0]);
  const auto one_place = optimize_pose(*scene.camera, scene.camera_from_map, same);
  for (const auto& result : {few, one_place}) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ErrorCode::kDegenerate);
  }
}

TEST(P3p, TruePoseIsAmongTheSolutionsAndAllReproject) {
  int solved = 0;
  constexpr int kTrials = 2000;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const Scene scene = make_scene(seed, 3, 0, 0);
    std::array<Eigen::Vector3d, 3> rays;
    std::array<Eigen::Vector3d, 3> points;
    for (size_t i = 0; i < 3; ++i) {
      points[i] = scene.observations[i].point_in_map;
      rays[i] = (scene.camera_from_map * points[i]).normalized();
    }
    double closest = 1e9;
    const auto poses = solve_p3p(rays, points);
    EXPECT_LE(poses.size(), 4U);
    for (const SE3& pose : poses) {
      closest = std::min(closest, error_of(scene, pose).norm());
      for (size_t i = 0; i < 3; ++i) {
        EXPECT_LT(((pose * points[i]).normalized() - rays[i]).norm(), 1e-7) << "seed " << seed;
      }
    }
    solved += closest < 1e-5 ? 1 : 0;
  }
  EXPECT_GE(solved, kTrials - 2);  // near the danger cylinder two solutions merge and digits are lost
}

TEST(P3p, CollinearPointsHaveNoSolution) {
  const std::array<Eigen::Vector3d, 3> points{Eigen::Vector3d(0, 0, 3), Eigen::Vector3d(1, 0, 3),
                                              Eigen::Vector3d(2, 0, 3)};
  const std::array<Eigen::Vector3d, 3> rays{points[0].normalized(), points[1].normalized(),
                                            points[2].normalized()};
  EXPECT_TRUE(solve_p3p(rays, points).empty());
}

TEST(RansacPose, FindsThePoseWithoutAStartUnderHalfOutliers) {
  for (unsigned seed = 1; seed <= 30; ++seed) {
    const Scene scene = make_scene(seed, 200, 0.5, 0.5);
    const auto found = ransac_pose(*scene.camera, scene.observations);
    ASSERT_TRUE(found) << "seed " << seed << ": " << found.error().message;
    EXPECT_LT(error_of(scene, found->camera_from_map).tail<3>().norm(), 0.003) << "seed " << seed;
    EXPECT_GE(found->inliers, 97) << "seed " << seed;
  }
}

TEST(RansacPose, RefusesNoiseAlone) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Scene scene = make_scene(seed, 100, 0, 1.0);
    PoseRansacOptions options;
    options.min_inliers = 20;
    EXPECT_FALSE(ransac_pose(*scene.camera, scene.observations, options)) << "seed " << seed;
  }
}

TEST(RansacPose, SameSeedSameBytes) {
  const Scene scene = make_scene(6, 150, 0.5, 0.4);
  const auto first = ransac_pose(*scene.camera, scene.observations);
  const auto second = ransac_pose(*scene.camera, scene.observations);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->camera_from_map.rotation().coeffs(), second->camera_from_map.rotation().coeffs());
  EXPECT_EQ(first->camera_from_map.translation(), second->camera_from_map.translation());
  EXPECT_EQ(first->weights, second->weights);
}

}  // namespace
}  // namespace cairn
