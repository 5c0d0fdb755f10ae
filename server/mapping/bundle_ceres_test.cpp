// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/bundle_ceres.h"

#include <gtest/gtest.h>

#include "common/bundle/bundle_scene.h"

namespace cairn {
namespace {

using namespace cairn::testing;  // NOLINT(google-build-using-namespace)

TEST(PoseManifold, MinusUndoesPlus) {
  const PoseManifold manifold;
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    double x[kPoseParameters];
    double y[kPoseParameters];
    pose_to_parameters(SE3::exp(random.twist(0.8)), x);
    const Vector6d delta = random.twist(0.3);
    Vector6d back;
    ASSERT_TRUE(manifold.Plus(x, delta.data(), y));
    ASSERT_TRUE(manifold.Minus(y, x, back.data()));
    EXPECT_LT((back - delta).norm(), 1e-12);
  }
}

TEST(ReprojectionCost, DerivativesAgreeWithCentralDifferences) {
  const CameraPtr camera = distorted_camera();
  const PoseManifold manifold;
  constexpr double kStep = 1e-6;
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    double pose[kPoseParameters];
    pose_to_parameters(SE3::exp(random.twist(0.1)), pose);
    Eigen::Vector3d point(random.uniform(-0.4, 0.4), random.uniform(-0.3, 0.3), random.uniform(0.8, 2));
    const ReprojectionCost cost(camera.get(), {random.uniform(0, 640), random.uniform(0, 480)}, 0.5);
    const double* parameters[2] = {pose, point.data()};
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, 7, Eigen::RowMajor> d_pose;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
    double* jacobians[2] = {d_pose.data(), d_point.data()};
    ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));
    for (int i = 0; i < 6; ++i) {
      Eigen::Vector2d ends[2];
      for (int side = 0; side < 2; ++side) {
        Vector6d delta = Vector6d::Zero();
        delta[i] = side == 0 ? -kStep : kStep;
        double moved[kPoseParameters];
        manifold.Plus(pose, delta.data(), moved);
        const double* at[2] = {moved, point.data()};
        cost.Evaluate(at, ends[side].data(), nullptr);
      }
      EXPECT_LT((d_pose.col(i) - (ends[1] - ends[0]) / (2 * kStep)).norm(), 1e-4) << "twist component " << i;
    }
    for (int i = 0; i < 3; ++i) {
      Eigen::Vector2d ends[2];
      for (int side = 0; side < 2; ++side) {
        Eigen::Vector3d moved = point;
        moved[i] += side == 0 ? -kStep : kStep;
        const double* at[2] = {pose, moved.data()};
        cost.Evaluate(at, ends[side].data(), nullptr);
      }
      EXPECT_LT((d_point.col(i) - (ends[1] - ends[0]) / (2 * kStep)).norm(), 1e-4) << "coordinate " << i;
    }
  }
}

/// Our own solver has to find what Ceres finds.
class Judged : public ::testing::TestWithParam<uint64_t> {};

TEST_P(Judged, AgreesWithCeresOnUniqueProblems) {
  Random random(GetParam());
  BundleProblem ours = noisy_walk(20, 400, &random);
  ours.poses[19].fixed = true;  // and with it the scale
  perturb(&ours, &random);
  BundleProblem theirs = ours;
  BundleOptions options;
  options.max_iterations = 200;
  options.function_tolerance = 1e-13;
  options.min_squared_cutoff = 1e4;  // the same cut-off for both, and one minimum within reach of both
  const BundleReport a = solve_bundle(&ours, options);
  const BundleReport b = solve_bundle_with_ceres(&theirs, options, {});
  ASSERT_TRUE(a.usable && b.usable);
  EXPECT_EQ(a.squared_cutoff, b.squared_cutoff);
  EXPECT_NEAR(a.initial_cost, b.initial_cost, 1e-12 * b.initial_cost);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-7 * b.final_cost);
  EXPECT_LT(largest_difference(ours, theirs), 1e-4);
}

TEST_P(Judged, AgreesWithCeresWhereOnlyPointsAreFixed) {
  Random random(GetParam());
  BundleProblem ours = noisy_walk(12, 300, &random);
  ours.poses[0].fixed = false;
  perturb(&ours, &random);
  for (size_t i = 0; i < ours.points.size(); ++i) ours.fixed_points.push_back(i % 3 == 0);
  const BundleProblem before = ours;
  BundleProblem theirs = ours;
  BundleOptions options;
  options.max_iterations = 200;
  options.function_tolerance = 1e-13;
  options.min_squared_cutoff = 1e4;
  const BundleReport a = solve_bundle(&ours, options);
  const BundleReport b = solve_bundle_with_ceres(&theirs, options, {});
  ASSERT_TRUE(a.usable && b.usable);
  EXPECT_LT(a.final_cost, a.initial_cost);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-7 * b.final_cost);
  EXPECT_LT(largest_difference(ours, theirs), 1e-4);
  for (size_t i = 0; i < ours.points.size(); i += 3) EXPECT_EQ(ours.points[i], before.points[i]);
}

TEST_P(Judged, ReachesTheCostOfCeresWhereTheScaleIsFree) {
  Random random(GetParam());
  BundleProblem ours = noisy_walk(30, 500, &random);
  perturb(&ours, &random);
  BundleProblem theirs = ours;
  BundleOptions options;
  options.max_iterations = 200;
  options.function_tolerance = 1e-12;
  options.min_squared_cutoff = 1e4;
  const BundleReport a = solve_bundle(&ours, options);
  const BundleReport b = solve_bundle_with_ceres(&theirs, options, {ceres::SPARSE_SCHUR});
  ASSERT_TRUE(a.usable && b.usable);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-6 * b.final_cost);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Judged, ::testing::Range<uint64_t>(1, 9));

}  // namespace
}  // namespace cairn
