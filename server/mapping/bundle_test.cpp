// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/bundle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "server/mapping/bundle_ceres.h"

namespace cairn {
namespace {

CameraPtr test_camera() {
  CameraParameters p;
  p.width = 640;
  p.height = 480;
  p.values = {500, 505, 320, 240, -0.15, 0.05, 0.001, -0.002};
  return *make_camera(p);
}

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  double normal(double sigma) { return std::normal_distribution<double>(0, sigma)(engine_); }
  Vector6d twist(double sigma) {
    Vector6d xi;
    for (int i = 0; i < 6; ++i) xi[i] = normal(sigma);
    return xi;
  }

 private:
  std::mt19937_64 engine_;
};

/// Cameras along a line in front of a box of points; every point seen by every camera, exactly. Two poses
/// fixed, so that the solution is unique.
BundleProblem exact_scene(Random* random) {
  BundleProblem problem;
  const CameraPtr camera = test_camera();
  for (int i = 0; i < 6; ++i) {
    Vector6d xi = random->twist(0.02);
    xi[0] -= 0.08 * i;
    problem.poses.push_back({SE3::exp(xi), camera, i < 2});
  }
  for (int i = 0; i < 120; ++i) {
    problem.points.emplace_back(random->uniform(-0.2, 0.6), random->uniform(-0.3, 0.3),
                                random->uniform(0.9, 1.6));
    for (int k = 0; k < 6; ++k) {
      const auto pose = static_cast<size_t>(k);
      const auto pixel = camera->project(problem.poses[pose].camera_from_map * problem.points.back());
      if (pixel) problem.observations.push_back({k, i, *pixel, 1.0 / (1 << (i % 3))});
    }
  }
  return problem;
}

/// By a few pixels, as before an adjustment in a map.
void perturb(BundleProblem* problem, Random* random) {
  for (BundlePose& p : problem->poses) {
    if (!p.fixed) p.camera_from_map = SE3::exp(random->twist(0.003)) * p.camera_from_map;
  }
  for (Eigen::Vector3d& p : problem->points) {
    p += Eigen::Vector3d(random->normal(0.004), random->normal(0.004), random->normal(0.004));
  }
}

/// Largest distance between poses (twist) and between points of two problems.
double largest_difference(const BundleProblem& a, const BundleProblem& b) {
  double largest = 0;
  for (size_t i = 0; i < a.poses.size(); ++i) {
    largest =
        std::max(largest, (a.poses[i].camera_from_map * b.poses[i].camera_from_map.inverse()).log().norm());
  }
  for (size_t i = 0; i < a.points.size(); ++i)
    largest = std::max(largest, (a.points[i] - b.points[i]).norm());
  return largest;
}

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
  const CameraPtr camera = test_camera();
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

TEST(SolveBundle, RecoversAnExactScene) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const BundleProblem truth = exact_scene(&random);
    BundleProblem problem = truth;
    perturb(&problem, &random);
    ASSERT_GT(largest_difference(problem, truth), 1e-3);
    BundleOptions options;
    options.function_tolerance = 1e-14;
    options.rounds = 2;
    const BundleReport report = solve_bundle(&problem, options);
    EXPECT_TRUE(report.usable);
    EXPECT_LT(largest_difference(problem, truth), 1e-6);
  }
}

TEST(SolveBundle, IgnoresOneWrongObservationInTen) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const BundleProblem truth = exact_scene(&random);
    BundleProblem problem = truth;
    for (size_t i = 0; i < problem.observations.size(); i += 10) {
      problem.observations[i].pixel += Eigen::Vector2d(random.uniform(20, 60), random.uniform(-60, -20));
    }
    perturb(&problem, &random);
    BundleOptions options;
    options.function_tolerance = 1e-14;
    options.rounds = 3;
    const BundleReport report = solve_bundle(&problem, options);
    EXPECT_TRUE(report.usable);
    EXPECT_LT(largest_difference(problem, truth), 1e-5);
    for (size_t i = 0; i < problem.observations.size(); ++i) {
      EXPECT_EQ(squared_residual(problem, problem.observations[i]) >= report.squared_cutoff, i % 10 == 0)
          << i;
    }
  }
}

TEST(SolveBundle, FixedPosesDoNotMove) {
  Random random(3);
  BundleProblem problem = exact_scene(&random);
  perturb(&problem, &random);
  const BundleProblem before = problem;
  ASSERT_TRUE(solve_bundle(&problem, {}).usable);
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    const bool same =
        problem.poses[i].camera_from_map.translation() == before.poses[i].camera_from_map.translation();
    EXPECT_EQ(same, problem.poses[i].fixed) << i;
  }
}

TEST(SolveBundle, APointBehindACameraIsAnOutlierNotAFailure) {
  Random random(4);
  const BundleProblem truth = exact_scene(&random);
  BundleProblem problem = truth;
  problem.points.emplace_back(0, 0, -1);
  problem.observations.push_back({0, static_cast<int>(problem.points.size()) - 1, {320, 240}, 1.0});
  problem.observations.push_back({3, static_cast<int>(problem.points.size()) - 1, {320, 240}, 1.0});
  perturb(&problem, &random);
  BundleOptions options;
  options.function_tolerance = 1e-14;
  options.rounds = 2;
  ASSERT_TRUE(solve_bundle(&problem, options).usable);
  EXPECT_TRUE(std::isinf(squared_residual(problem, problem.observations.back())));
  problem.points.pop_back();
  EXPECT_LT(largest_difference(truth, problem), 1e-6);
}

TEST(SolveBundle, LeavesADamagedProblemAsItWas) {
  Random random(5);
  BundleProblem problem = exact_scene(&random);
  problem.points[7].x() = std::nan("");
  const BundleProblem before = problem;
  EXPECT_FALSE(solve_bundle(&problem, {}).usable);
  EXPECT_TRUE(std::isnan(problem.points[7].x()));
  EXPECT_EQ(problem.points[8], before.points[8]);
  EXPECT_EQ(problem.poses[4].camera_from_map.translation(), before.poses[4].camera_from_map.translation());
}

TEST(SolveBundle, KeepsWhatWasReachedWhenStopped) {
  Random random(6);
  BundleProblem problem = exact_scene(&random);
  perturb(&problem, &random);
  int polls = 0;
  BundleOptions options;
  options.function_tolerance = 1e-14;
  options.should_stop = [&polls] { return ++polls > 2; };
  const BundleReport report = solve_bundle(&problem, options);
  EXPECT_EQ(polls, 3);
  EXPECT_TRUE(report.usable);
  EXPECT_FALSE(report.converged);
  EXPECT_LT(report.final_cost, 0.5 * report.initial_cost);
}

TEST(SolveBundle, SameInputSameBytes) {
  Random random(7);
  BundleProblem a = exact_scene(&random);
  perturb(&a, &random);
  BundleProblem b = a;
  ASSERT_TRUE(solve_bundle(&a, {}).usable);
  ASSERT_TRUE(solve_bundle(&b, {}).usable);
  for (size_t i = 0; i < a.poses.size(); ++i) {
    EXPECT_EQ(a.poses[i].camera_from_map.translation(), b.poses[i].camera_from_map.translation());
    EXPECT_EQ(a.poses[i].camera_from_map.rotation().coeffs(), b.poses[i].camera_from_map.rotation().coeffs());
  }
  EXPECT_EQ(a.points, b.points);
}

}  // namespace
}  // namespace cairn
