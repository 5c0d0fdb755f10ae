// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/refine.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>

#include "server/relocalization/exact_map.h"

namespace cairn {
namespace {

using testing::describe_image;
using testing::error_of;
using testing::ExactMap;
using testing::Scene;

constexpr uint64_t kSeed = 20261124;
constexpr int kStep = 5;  ///< of the scene's camera, between keyframes

class RefineTest : public ::testing::Test {
 protected:
  /// Points of all keyframes in the image of a camera there.
  [[nodiscard]] ProjectedPoints points_in_view(const SE3& pose) const {
    ProjectedPoints points;
    const std::vector<size_t> all = {0, 1, 2};
    project_points(*scene_.camera(), pose, *index_, all, 0, &points);
    return points;
  }

  /// The pose `truth` as what is measured in the left quarter of the image leaves it, with its
  /// covariance.
  [[nodiscard]] PoseEstimate known_on_the_left(const SE3& truth) const {
    std::vector<PointObservation> observations;
    for (const ProjectedPoint& p : points_in_view(truth).points) {
      if (p.pixel.x() < scene_.camera()->width() / 4) observations.push_back({p.position, p.pixel, 1});
    }
    return *optimize_pose(*scene_.camera(), truth, observations);
  }

  Scene scene_{11};
  ExactMap map_{scene_, 1, {0, 4, 8}};
  IndexedMapPtr index_ = map_.index();
};

TEST_F(RefineTest, PointsAreLookedForAsTheyLookAtTheExposureOfTheQuery) {
  const std::vector<size_t> first = {0};
  const IndexedKeyframe& keyframe = *index_->keyframes[0];
  ASSERT_TRUE(keyframe.overexposed);
  for (const auto& [white, exposed] : {std::pair(0.0F, &keyframe.as_taken), {1.0F, &*keyframe.overexposed}}) {
    ProjectedPoints points;
    project_points(*scene_.camera(), Scene::pose(0), *index_, first, white, &points);
    ASSERT_GT(points.sightings.size(), 50U);
    for (const KeyframeSighting& s : points.sightings) {
      const auto measured = static_cast<size_t>(s.sighting - keyframe.sightings.data());
      for (uint8_t d = 0; d < s.sighting->descriptions; ++d)
        EXPECT_EQ(s.descriptors[d], &exposed->descriptors[exposed->of_measured[measured][d]]);
    }
  }
}

TEST_F(RefineTest, TheVarianceOfAPixelIsThatOfManyPoses) {
  const SE3 truth = Scene::pose(kStep);
  const PoseEstimate pose = known_on_the_left(truth);
  const Eigen::Matrix<double, 6, 6> root = pose.covariance.llt().matrixL();
  std::mt19937_64 random(kSeed);
  std::normal_distribution<double> normal;
  const ProjectedPoints points = points_in_view(truth);
  for (const size_t i : {size_t{0}, points.points.size() / 2, points.points.size() - 1}) {
    const ProjectedPoint& point = points.points[i];
    double sum = 0;
    constexpr int kDrawn = 4000;
    for (int n = 0; n < kDrawn; ++n) {
      Eigen::Matrix<double, 6, 1> unit;
      for (double& u : unit) u = normal(random);
      const SE3 drawn = SE3::exp(root * unit) * truth;
      sum += (*scene_.camera()->project(drawn * point.position) - point.pixel).squaredNorm();
    }
    const double variance = variance_of_pixel(*scene_.camera(), pose, point.position);
    EXPECT_NEAR(variance / (sum / kDrawn), 1, 0.1) << "seed " << kSeed;
  }
  const Eigen::Vector3d behind = truth.inverse() * Eigen::Vector3d(0, 0, -1);
  EXPECT_TRUE(std::isinf(variance_of_pixel(*scene_.camera(), pose, behind)));
}

TEST_F(RefineTest, CertainIsWhatLiesWhereThePoseIsKnown) {
  const SE3 truth = Scene::pose(kStep);
  PoseEstimate pose = known_on_the_left(truth);
  ProjectedPoints points = points_in_view(truth);
  const size_t all = points.points.size();
  pose.covariance *= 400;  // as if of fewer corners, and worse ones
  keep_certain(*scene_.camera(), pose, 6, &points, RefineOptions());
  EXPECT_GT(points.points.size(), all / 20);
  EXPECT_LT(points.points.size(), all / 2);
  double mean = 0;
  for (const ProjectedPoint& p : points.points)
    mean += p.pixel.x() / static_cast<double>(points.points.size());
  EXPECT_LT(mean, scene_.camera()->width() / 3) << "most are where the pose is known";

  points = points_in_view(truth);
  pose.covariance.setZero();
  keep_certain(*scene_.camera(), pose, 6, &points, RefineOptions());
  EXPECT_EQ(points.points.size(), all);
}

TEST_F(RefineTest, FromOneCornerOfTheImageThePoseGrowsOverAllOfIt) {
  const SE3 truth = Scene::pose(kStep);
  const auto image = scene_.render(truth, kSeed);
  const PlaceView view = describe_image(image->view());
  const CornerGrid grid(view, *scene_.camera());
  PoseEstimate pose = known_on_the_left(truth);
  // Two sigmas in the direction that is known least: where nothing was measured, points lie far from where
  // they are looked for.
  pose.covariance *= 1600;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> axes(pose.covariance);
  const Vector6d away = 2 * std::sqrt(axes.eigenvalues()[5]) * axes.eigenvectors().col(5);
  for (const double sign : {-1.0, 1.0}) {
    SCOPED_TRACE(sign);
    pose.camera_from_map = SE3::exp(sign * away) * truth;
    double farthest = 0;
    for (const ProjectedPoint& p : points_in_view(truth).points) {
      const auto there = scene_.camera()->project(pose.camera_from_map * p.position);
      if (there) farthest = std::max(farthest, (*there - p.pixel).norm());
    }
    ASSERT_GT(farthest, 12) << "beyond what is searched";
    const auto refined =
        refine(view, grid, *scene_.camera(), *index_, 1, pose, RefineOptions(), MatchOptions());
    ASSERT_TRUE(refined) << refined.error().message;
    EXPECT_LT(error_of(refined->pose.camera_from_map, truth, *map_.snapshot()), 0.01);
  }
}

/// A map of which the keyframes around the query have few points: they are of another place, which the camera
/// has been put next to.
TEST_F(RefineTest, ThePointsOfTheKeyframeThatThePoseComesFromAreLookedForWhateverLiesNearer) {
  const Scene elsewhere(12);
  const ExactMap both(2, {{.scene = &scene_, .steps = {0}}, {.scene = &elsewhere, .steps = {4, 5, 6, 7}}});
  const IndexedMapPtr index = both.index();
  const SE3 truth = Scene::pose(kStep);
  const auto image = scene_.render(truth, kSeed);
  const PlaceView view = describe_image(image->view());
  const CornerGrid grid(view, *scene_.camera());
  PoseEstimate pose = known_on_the_left(truth);
  const auto refined = refine(view, grid, *scene_.camera(), *index, 0, pose, RefineOptions(), MatchOptions());
  ASSERT_TRUE(refined) << refined.error().message;
  EXPECT_LT(error_of(refined->pose.camera_from_map, truth, *both.snapshot()), 0.01);
  EXPECT_GT(refined->pose.inliers, 50);
}

}  // namespace
}  // namespace cairn
