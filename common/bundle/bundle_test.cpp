// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/bundle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/bundle/bundle_scene.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

using namespace cairn::testing;  // NOLINT(google-build-using-namespace)

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
    const std::vector<double> residuals = squared_residuals(problem);
    for (size_t i = 0; i < residuals.size(); ++i) {
      EXPECT_EQ(residuals[i] >= report.squared_cutoff, i % 10 == 0) << i;
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
  EXPECT_TRUE(std::isinf(squared_residuals(problem).back()));
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
  // Stopped at every poll in turn: the cost only falls, and most stops come after an iteration or more.
  Random random(6);
  const BundleProblem start = [&] {
    BundleProblem problem = noisy_walk(20, 600, &random);
    perturb(&problem, &random);
    return problem;
  }();
  BundleOptions options;
  options.function_tolerance = 1e-9;
  int total = 0;
  options.should_stop = [&total] { return ++total < 0; };
  BundleProblem whole = start;
  const BundleReport finished = solve_bundle(&whole, options);
  ASSERT_GT(total, 10);
  double last = finished.initial_cost;
  for (int stop_at = 1; stop_at <= total; ++stop_at) {
    int polls = 0;
    options.should_stop = [&polls, stop_at] { return ++polls >= stop_at; };
    BundleProblem problem = start;
    const BundleReport report = solve_bundle(&problem, options);
    EXPECT_EQ(polls, stop_at) << "goes on after being told to stop";
    EXPECT_TRUE(report.usable);
    EXPECT_FALSE(report.converged);
    EXPECT_LE(report.final_cost, last * (1 + 1e-12));
    last = report.final_cost;
  }
  EXPECT_LT(last, 0.5 * finished.initial_cost);
}

TEST(SolveBundle, GradientsVanishAtTheEnd) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    BundleProblem problem = noisy_walk(12, 150, &random);
    perturb(&problem, &random);
    BundleOptions options;
    options.max_iterations = 300;
    options.function_tolerance = 1e-15;
    options.min_squared_cutoff = 1e4;
    const auto cost = [&problem](double squared_cutoff) {
      double sum = 0;
      for (const double s : squared_residuals(problem)) sum += tukey_cost(s, squared_cutoff);
      return sum;
    };
    const auto slope = [&](Eigen::Vector3d* point, int i, double squared_cutoff) {
      constexpr double kStep = 1e-6;
      (*point)[i] += kStep;
      const double above = cost(squared_cutoff);
      (*point)[i] -= 2 * kStep;
      const double below = cost(squared_cutoff);
      (*point)[i] += kStep;
      return (above - below) / (2 * kStep);
    };
    const double before = std::abs(slope(&problem.points[5], 0, 1e4));
    const BundleReport report = solve_bundle(&problem, options);
    ASSERT_TRUE(report.usable);
    ASSERT_EQ(report.squared_cutoff, 1e4);
    ASSERT_GT(before, 10);
    for (Eigen::Vector3d& point : problem.points) {
      for (int i = 0; i < 3; ++i) EXPECT_LT(std::abs(slope(&point, i, 1e4)), 0.05);
    }
    for (BundlePose& pose : problem.poses) {
      if (pose.fixed) continue;
      for (int i = 0; i < 6; ++i) {
        const SE3 solved = pose.camera_from_map;
        Vector6d xi = Vector6d::Zero();
        xi[i] = 1e-6;
        pose.camera_from_map = SE3::exp(xi) * solved;
        const double above = cost(1e4);
        pose.camera_from_map = SE3::exp(-xi) * solved;
        const double below = cost(1e4);
        pose.camera_from_map = solved;
        EXPECT_LT(std::abs(above - below) / 2e-6, 0.5);
      }
    }
  }
}

TEST(SolveBundle, OrderAndRepetitionOfObservationsDoNotMatter) {
  // The same pair of pose and point twice with half the weight each is once.
  Random random(8);
  BundleProblem once = exact_scene(&random);
  for (BundleObservation& o : once.observations) {
    o.pixel += Eigen::Vector2d(random.normal(0.5), random.normal(0.5));
  }
  perturb(&once, &random);
  BundleProblem twice = once;
  std::shuffle(twice.observations.begin(), twice.observations.end(), std::mt19937(8));
  for (BundleObservation& o : twice.observations) o.inverse_sigma *= std::sqrt(0.5);
  const std::vector<BundleObservation> half = twice.observations;
  twice.observations.insert(twice.observations.end(), half.begin(), half.end());
  BundleOptions options;
  options.max_iterations = 100;
  options.function_tolerance = 1e-14;
  options.min_squared_cutoff = 1e8;  // so far out that halving the squares changes no weight
  ASSERT_TRUE(solve_bundle(&once, options).usable);
  ASSERT_TRUE(solve_bundle(&twice, options).usable);
  EXPECT_LT(largest_difference(once, twice), 1e-5);
}

TEST(SolveBundle, NoMovingPoseLeavesThePoints) {
  Random random(9);
  const BundleProblem truth = exact_scene(&random);
  BundleProblem problem = truth;
  for (BundlePose& p : problem.poses) p.fixed = true;
  for (Eigen::Vector3d& p : problem.points) p += Eigen::Vector3d(0.003, -0.002, 0.004);
  BundleOptions options;
  options.function_tolerance = 1e-14;
  ASSERT_TRUE(solve_bundle(&problem, options).usable);
  EXPECT_LT(largest_difference(problem, truth), 1e-7);
}

TEST(SolveBundle, FixedPointsDoNotMoveAndHoldAllElse) {
  Random random(10);
  BundleProblem truth = exact_scene(&random);
  for (BundlePose& p : truth.poses) p.fixed = false;
  BundleProblem problem = truth;
  perturb(&problem, &random);
  for (size_t i = 0; i < truth.points.size(); ++i) {
    problem.fixed_points.push_back(i % 4 == 0);
    if (i % 4 == 0) problem.points[i] = truth.points[i];
  }
  BundleOptions options;
  options.max_iterations = 100;
  options.function_tolerance = 1e-14;
  ASSERT_TRUE(solve_bundle(&problem, options).usable);
  EXPECT_LT(largest_difference(problem, truth), 1e-7);
  for (size_t i = 0; i < truth.points.size(); i += 4) EXPECT_EQ(problem.points[i], truth.points[i]);
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
