// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>
#include <random>
#include <vector>

#include "common/geometry/least_squares.h"
#include "common/geometry/levenberg_marquardt.h"
#include "common/geometry/ransac.h"

namespace cairn {
namespace {

struct Line {
  double slope = 0;
  double offset = 0;
  [[nodiscard]] double squared_residual(const Eigen::Vector2d& p) const {
    const double r = slope * p.x() + offset - p.y();
    return r * r;
  }
};

/// Points near y = 2 x - 1, and as many anywhere.
std::vector<Eigen::Vector2d> half_outliers(unsigned seed) {
  std::mt19937 engine(seed);
  std::uniform_real_distribution<double> anywhere(-10, 10);
  std::normal_distribution<double> noise(0, 0.01);
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 50; ++i) {
    const double x = anywhere(engine);
    points.emplace_back(x, 2 * x - 1 + noise(engine));
    points.emplace_back(anywhere(engine), anywhere(engine));
  }
  return points;
}

constexpr double kCutoff = 0.01;

struct Fitted {
  std::optional<Line> line;
  int trials = 0;
};

Fitted fit_line(const std::vector<Eigen::Vector2d>& points, bool stops_early, uint64_t seed) {
  RansacOptions options;
  options.population = points.size();
  options.all_outliers = kCutoff * static_cast<double>(points.size());
  options.most_trials = 200;
  options.stops_early = stops_early;
  options.seed = seed;
  Fitted fitted;
  fitted.line = ransac<2, Line>(
      options, [&](const std::array<size_t, 2>& sample, double limit) -> std::optional<Hypothesis<Line>> {
        ++fitted.trials;
        const Eigen::Vector2d along = points[sample[1]] - points[sample[0]];
        const double slope = along.y() / along.x();
        const Line line{slope, points[sample[0]].y() - slope * points[sample[0]].x()};
        const double cost = truncated_cost(
            points, kCutoff, limit, [&](const Eigen::Vector2d& p) { return line.squared_residual(p); });
        if (!(cost < limit)) return std::nullopt;
        return Hypothesis<Line>{line, cost};
      });
  return fitted;
}

TEST(Ransac, FindsWhatHalfOfTheItemsAgreeOn) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Fitted fitted = fit_line(half_outliers(seed), true, seed);
    ASSERT_TRUE(fitted.line) << "seed " << seed;
    EXPECT_NEAR(fitted.line->slope, 2, 0.05) << "seed " << seed;
    EXPECT_NEAR(fitted.line->offset, -1, 0.3) << "seed " << seed;
  }
}

TEST(Ransac, StopsOnceASampleOfInliersIsAsGoodAsCertainAndOnlyIfItMay) {
  const auto points = half_outliers(3);
  const Fitted early = fit_line(points, true, 3);
  EXPECT_LT(early.trials, 100);
  EXPECT_GE(early.trials, required_trials(0.6, 2, 200));
  EXPECT_EQ(fit_line(points, false, 3).trials, 200);
}

TEST(Ransac, TheSameSeedGivesTheSameBytes) {
  const auto points = half_outliers(4);
  const Fitted first = fit_line(points, true, 4);
  const Fitted second = fit_line(points, true, 4);
  ASSERT_TRUE(first.line && second.line);
  EXPECT_EQ(first.line->slope, second.line->slope);
  EXPECT_EQ(first.line->offset, second.line->offset);
  EXPECT_EQ(first.trials, second.trials);
}

TEST(Ransac, OfOutliersAloneNothingIsFound) {
  RansacOptions options;
  options.population = 10;
  options.all_outliers = 10;
  options.most_trials = 50;
  const auto found = ransac<3, int>(
      options,
      [](const std::array<size_t, 3>&, double) -> std::optional<Hypothesis<int>> { return std::nullopt; });
  EXPECT_FALSE(found);
}

TEST(TruncatedCost, CutsEachItemOffAndStopsAtTheLimit) {
  const std::vector<double> items{1, 5, 2, 9};
  int asked = 0;
  const auto residual = [&](double item) {
    ++asked;
    return item;
  };
  EXPECT_EQ(truncated_cost(items, 4, 100, residual), 1 + 4 + 2 + 4);
  EXPECT_EQ(asked, 4);
  EXPECT_GE(truncated_cost(items, 4, 5, residual), 5);
  EXPECT_EQ(asked, 6);
}

TEST(LeastSquares, TheStepIsThatOfTheWeightedProblem) {
  std::mt19937 engine(5);
  std::normal_distribution<double> normal;
  Eigen::Matrix<double, 20, 3> jacobian;
  Eigen::Matrix<double, 20, 1> residual;
  LeastSquares<3> equations;
  for (int i = 0; i < 20; i += 2) {
    const double weight = 0.5 + i;
    Eigen::Matrix<double, 2, 3> rows;
    Eigen::Vector2d r;
    for (int k = 0; k < 2; ++k) {
      for (int column = 0; column < 3; ++column) rows(k, column) = normal(engine);
      r(k) = normal(engine);
    }
    jacobian.middleRows<2>(i) = std::sqrt(weight) * rows;
    residual.segment<2>(i) = std::sqrt(weight) * r;
    // A residual of two rows is two residuals.
    if (i % 4 == 0) {
      equations.add(rows, r, weight);
    } else {
      for (int k = 0; k < 2; ++k) equations.add(rows.row(k).transpose(), r(k), weight);
    }
  }
  const auto step = equations.step();
  ASSERT_TRUE(step);
  const Eigen::Vector3d expected = -jacobian.colPivHouseholderQr().solve(residual);
  EXPECT_LT((*step - expected).norm(), 1e-12);
  const auto damped = equations.step(10);
  ASSERT_TRUE(damped);
  EXPECT_LT(damped->norm(), step->norm());
}

/// Rosenbrock's valley, as residuals 10 (y - x^2) and 1 - x.
Eigen::Vector2d valley(const Eigen::Vector2d& at) {
  return {10 * (at.y() - at.x() * at.x()), 1 - at.x()};
}

TEST(LevenbergMarquardt, FollowsAValleyToItsMinimumAndNeverGoesUp) {
  Eigen::Vector2d at(-1.2, 1);
  std::vector<double> costs;
  const auto cost = [](const Eigen::Vector2d& x) { return valley(x).squaredNorm(); };
  LevenbergMarquardtOptions options;
  options.iterations = 100;
  options.attempts = 20;
  levenberg_marquardt(
      options, &at,
      [&](const Eigen::Vector2d& x) {
        costs.push_back(cost(x));
        Eigen::Matrix2d jacobian;
        jacobian << -20 * x.x(), 10, -1, 0;
        LeastSquares<2> equations;
        equations.add(jacobian, valley(x));
        return equations;
      },
      [](const Eigen::Vector2d& x, const LeastSquares<2>& equations,
         double damping) -> std::optional<Eigen::Vector2d> {
        const auto step = equations.step(damping);
        if (!step) return std::nullopt;
        return Eigen::Vector2d(x + *step);
      },
      cost);
  EXPECT_LT((at - Eigen::Vector2d(1, 1)).norm(), 1e-6);
  ASSERT_GT(costs.size(), 3U);
  for (size_t i = 1; i < costs.size(); ++i) EXPECT_LT(costs[i], costs[i - 1]);
}

TEST(LevenbergMarquardt, WhereNoStepLeadsDownTheStateStays) {
  for (const bool has_step : {false, true}) {
    double at = 7;
    int tried = 0;
    LevenbergMarquardtOptions options;
    options.attempts = 5;
    levenberg_marquardt(
        options, &at, [](double) { return 0; },
        [&](double x, int, double) -> std::optional<double> {
          ++tried;
          return has_step ? std::optional(x + 1) : std::nullopt;
        },
        [](double x) { return x; });
    EXPECT_EQ(at, 7);
    EXPECT_EQ(tried, 5);
  }
}

TEST(LevenbergMarquardt, TheDampingGrowsWithEachAttemptAndEndsAtItsLimit) {
  double at = 7;
  std::vector<double> dampings;
  LevenbergMarquardtOptions options;
  options.attempts = 1000;
  options.most_damping = 1;
  levenberg_marquardt(
      options, &at, [](double) { return 0; },
      [&](double, int, double damping) -> std::optional<double> {
        dampings.push_back(damping);
        return std::nullopt;
      },
      [](double x) { return x; });
  ASSERT_EQ(dampings.size(), 4U);  // 1e-4, and 20 times as much each time, below 1
  for (size_t i = 1; i < dampings.size(); ++i) EXPECT_DOUBLE_EQ(dampings[i], 20 * dampings[i - 1]);
}

}  // namespace
}  // namespace cairn
