// SPDX-License-Identifier: Apache-2.0
//
// Bundle adjustment: the product's solver and Ceres in several settings on the same problems, one thread,
// CPU time. All minimize the same robust cost (Tukey, cut-off from the residuals at the start).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include "common/base/log.h"
#include "server/mapping/adjustment.h"
#include "server/mapping/bundle_ceres.h"
#include "tests/bench/bundle_file.h"
#include "tests/bench/json_file.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

constexpr double kGoal = 1.01;  ///< times the converged cost
constexpr int kMostIterations = 64;
constexpr int kUntilConverged = 200;
constexpr const char* kSynthetic = "synthetic";

struct Variant {
  const char* name;
  std::function<BundleReport(BundleProblem*, const BundleOptions&)> solve;
};

Variant ceres_variant(const char* name, const CeresVariant& variant) {
  return {name, [variant](BundleProblem* problem, const BundleOptions& options) {
            return solve_bundle_with_ceres(problem, options, variant);
          }};
}

std::vector<Variant> all_variants() {
  return {{"own", solve_bundle},
          ceres_variant("ceres dense", {.linear_solver = ceres::DENSE_SCHUR}),
          ceres_variant("ceres dense, its order",
                        {.linear_solver = ceres::DENSE_SCHUR, .ordered_by_hand = false}),
          ceres_variant("ceres sparse", {.linear_solver = ceres::SPARSE_SCHUR}),
          ceres_variant("ceres iterative", {.linear_solver = ceres::ITERATIVE_SCHUR}),
          ceres_variant("ceres iterative, explicit",
                        {.linear_solver = ceres::ITERATIVE_SCHUR, .explicit_schur = true})};
}

struct Run {
  BundleReport report;
  double ms = 0;
};

Run timed(const Variant& variant, const BundleProblem& start, const BundleOptions& options) {
  BundleProblem problem = start;
  const double before = thread_cpu_ms();
  Run run{.report = variant.solve(&problem, options)};
  run.ms = thread_cpu_ms() - before;
  return run;
}

Run best_of(int repeats, const Variant& variant, const BundleProblem& start, const BundleOptions& options) {
  Run best = timed(variant, start, options);
  for (int i = 1; i < repeats; ++i) best.ms = std::min(best.ms, timed(variant, start, options).ms);
  return best;
}

BundleOptions to_the_end(int iterations) {
  BundleOptions options;
  options.max_iterations = iterations;
  options.function_tolerance = 1e-9;
  return options;
}

/// The fewest iterations that reach a cost, by doubling and halving; 0 if kMostIterations do not.
int iterations_to(double goal, const Variant& variant, const BundleProblem& start) {
  const auto reaches = [&](int iterations) {
    const BundleReport report = timed(variant, start, to_the_end(iterations)).report;
    return report.usable && report.final_cost <= goal;
  };
  int enough = 1;
  while (!reaches(enough)) {
    enough *= 2;
    if (enough > kMostIterations) return 0;
  }
  int too_few = enough / 2;
  while (enough - too_few > 1) {
    const int middle = (enough + too_few) / 2;
    (reaches(middle) ? enough : too_few) = middle;
  }
  return enough;
}

/// Longest time between two questions whether to stop.
double longest_poll_gap(const Variant& variant, const BundleProblem& start) {
  BundleOptions options = global_options(AdjustmentOptions(), [] { return false; });
  double last = thread_cpu_ms();
  double longest = 0;
  options.should_stop = [&] {
    const double now = thread_cpu_ms();
    longest = std::max(longest, now - last);
    last = now;
    return false;
  };
  static_cast<void>(timed(variant, start, options));
  return std::max(longest, thread_cpu_ms() - last);
}

/// Cameras around a desk, looking at its middle: `poses` x `points` with about `observations`, 0.4 sigma of
/// noise, 2 % of wrong ones; states off by what is usual before a global adjustment.
BundleProblem synthetic_desk(int poses, int points, int observations) {
  std::mt19937_64 random(1);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  const auto normal = [&](double sigma) {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += uniform(0, 1);
    return sigma * sum;
  };
  CameraParameters parameters;
  parameters.width = 640;
  parameters.height = 480;
  parameters.values = {500, 505, 320, 240, -0.1, 0.03};
  const CameraPtr camera = *make_camera(parameters);
  BundleProblem problem;
  for (int i = 0; i < poses; ++i) {
    const double angle = 2 * std::numbers::pi * i / poses;
    const Eigen::Vector3d center(1.6 * std::cos(angle), 1.6 * std::sin(angle),
                                 1.0 + 0.3 * std::sin(5 * angle));
    const Eigen::Vector3d z = -center.normalized();
    const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
    Eigen::Matrix3d R;
    R << x.transpose(), z.cross(x).transpose(), z.transpose();
    problem.poses.push_back({SE3(R, -(R * center)), camera, i == 0});
  }
  const double sight = static_cast<double>(observations) / points / poses / 0.3;
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector3d point(uniform(-0.7, 0.7), uniform(-0.7, 0.7), uniform(0, 0.4));
    const double facing = uniform(0, 2 * std::numbers::pi);
    std::vector<BundleObservation> seen;
    for (int k = 0; k < poses; ++k) {
      if (std::cos(2 * std::numbers::pi * k / poses - facing) < 0.588 || uniform(0, 1) > sight) continue;
      const auto pixel = camera->project(problem.poses[static_cast<size_t>(k)].camera_from_map * point);
      if (!pixel || !camera->in_image(*pixel)) continue;
      const double sigma = 1 << (random() % 3);
      Eigen::Vector2d noise(normal(0.4 * sigma), normal(0.4 * sigma));
      if (uniform(0, 1) < 0.02) noise += Eigen::Vector2d(normal(20), normal(20));
      seen.push_back({k, static_cast<int>(problem.points.size()), *pixel + noise, 1 / sigma});
    }
    if (seen.size() < 2) continue;
    problem.points.push_back(point + Eigen::Vector3d(normal(0.003), normal(0.003), normal(0.003)));
    problem.observations.insert(problem.observations.end(), seen.begin(), seen.end());
  }
  for (BundlePose& p : problem.poses) {
    Vector6d xi;
    for (double& v : xi) v = normal(0.002);
    if (!p.fixed) p.camera_from_map = SE3::exp(xi) * p.camera_from_map;
  }
  return problem;
}

/// Compares and prints variants of a solver, and returns what was printed as JSON.
nlohmann::json compare(const std::string& name, const BundleProblem& start,
                       const std::vector<Variant>& variants, int repeats) {
  const BundleReport end = timed(variants.front(), start, to_the_end(kUntilConverged)).report;
  const BundleReport judge = timed(ceres_variant("judge", {.linear_solver = ceres::SPARSE_SCHUR}), start,
                                   to_the_end(kUntilConverged))
                                 .report;
  const double converged = std::min(end.final_cost, judge.final_cost);
  std::printf(
      "\n%s: %zu poses, %zu points, %zu observations; cut-off %.1f sigma; cost %.6g, converged %.6g "
      "(own %.7g, Ceres %.7g)\n",
      name.c_str(), start.poses.size(), start.points.size(), start.observations.size(),
      std::sqrt(end.squared_cutoff), end.initial_cost, converged, end.final_cost, judge.final_cost);
  std::printf(
      "| solver | to 1 %%: iterations | ms | as the product asks: iterations | ms | above converged | "
      "longest between polls, ms |\n"
      "|---|---|---|---|---|---|---|\n");
  nlohmann::json solvers = nlohmann::json::array();
  for (const Variant& variant : variants) {
    const int iterations = iterations_to(kGoal * converged, variant, start);
    nlohmann::json solver = {
        {"solver", variant.name}, {"iterations_to_goal", nullptr}, {"ms_to_goal", nullptr}};
    std::printf("| %s | ", variant.name);
    if (iterations > 0) {
      const double ms = best_of(repeats, variant, start, to_the_end(iterations)).ms;
      solver["iterations_to_goal"] = iterations;
      solver["ms_to_goal"] = ms;
      std::printf("%d | %.1f", iterations, ms);
    } else {
      std::printf("not in %d | -", kMostIterations);
    }
    const Run product = best_of(repeats, variant, start, global_options(AdjustmentOptions(), {}));
    const double above = 100 * (product.report.final_cost / converged - 1);
    const double gap = longest_poll_gap(variant, start);
    std::printf(" | %d | %.1f | %.2f %% | %.1f |\n", product.report.iterations, product.ms, above, gap);
    std::fflush(stdout);
    solver.update({{"iterations", product.report.iterations},
                   {"ms", product.ms},
                   {"above_converged_percent", above},
                   {"longest_poll_ms", gap}});
    solvers.push_back(std::move(solver));
  }
  return {{"problem", name},
          {"poses", start.poses.size()},
          {"points", start.points.size()},
          {"observations", start.observations.size()},
          {"solvers", std::move(solvers)}};
}

Status run(const std::vector<std::string>& files, const std::string& only, int repeats,
           const std::string& json) {
  std::vector<Variant> variants;
  for (Variant& v : all_variants()) {
    if (std::string(v.name).starts_with(only)) variants.push_back(std::move(v));
  }
  if (variants.empty()) return fail(ErrorCode::kUsage, only + ": no solver's name begins so");
  nlohmann::json figures = nlohmann::json::array();
  for (const std::string& file : files) {
    if (file == kSynthetic) {
      figures.push_back(compare(file, synthetic_desk(118, 25'000, 184'000), variants, repeats));
      continue;
    }
    const auto problem = read_bundle(file);
    if (!problem) return tl::unexpected(problem.error());
    figures.push_back(compare(std::filesystem::path(file).filename().string(), *problem, variants, repeats));
  }
  return write_figures(json, figures);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Bundle adjustment: the product's solver beside Ceres, one thread, CPU time");
  std::vector<std::string> files;
  std::string only;
  std::string json;
  int repeats = 3;
  app.add_option("files", files, "BAL problems, dumps of cairn-engine-run --bundle, or 'synthetic'")
      ->required();
  app.add_option("--only", only, "solvers whose name begins so: own, ceres dense, ...");
  app.add_option("--repeats", repeats, "the shortest of so many runs counts");
  app.add_option("--json", json, "write the figures here, for write-figures")->type_name("FILE");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(files, only, repeats, json); !done) {
    cairn::say_error("cairn-ba-bench", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
