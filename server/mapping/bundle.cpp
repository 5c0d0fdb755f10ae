// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/bundle.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "server/mapping/bundle_rounds.h"
#include "server/mapping/point_elimination.h"

namespace cairn {
namespace {

// With one fixed pose the scale is free: without some damping the reduced system is singular.
constexpr double kMinLambda = 1e-8;
constexpr double kFirstLambda = 1e-4;
constexpr double kMaxLambda = 1e8;
constexpr double kAfterGoodStep = 0.1;
constexpr double kAfterBadStep = 10;

using Outcome = ReducedSystem::Outcome;

/// Levenberg-Marquardt. A candidate's cost and the system for the step after it come from one pass over the
/// observations, in the hope, rarely wrong, that the candidate is better.
class LevenbergMarquardt {
 public:
  LevenbergMarquardt(const BundleProblem& problem, const BundleOptions& options)
      : options_(&options), equations_(problem, best_tile_kernels()) {
    for (const BundlePose& p : problem.poses) state_.poses.push_back(p.camera_from_map);
    state_.points = problem.points;
  }

  MinimisationReport minimise(double squared_cutoff, int max_iterations) {
    report_ = {.usable = true};
    squared_cutoff_ = squared_cutoff;
    lambda_ = kFirstLambda;
    const auto start = linearise(state_);
    if (!start) return report_;
    cost_ = *start;
    while (report_.iterations < max_iterations && !report_.converged && !report_.stopped &&
           lambda_ <= kMaxLambda) {
      iterate(report_.iterations + 1 == max_iterations);
    }
    return report_;
  }

  void write_to(BundleProblem* problem) const {
    for (size_t i = 0; i < state_.poses.size(); ++i) {
      if (!problem->poses[i].fixed) problem->poses[i].camera_from_map = state_.poses[i];
    }
    problem->points = state_.points;
  }

 private:
  std::optional<double> linearise(const BundleState& state) {
    const auto cost = equations_.linearise(state, squared_cutoff_, lambda_, options_->should_stop);
    report_.stopped = !cost;
    return cost;
  }

  void iterate(bool last) {
    switch (equations_.solve(&step_, options_->should_stop)) {
      case Outcome::kStopped:
        report_.stopped = true;
        return;
      case Outcome::kSingular:
        back_off();
        return;
      case Outcome::kDone:
        break;
    }
    ++report_.iterations;
    equations_.apply(step_, state_, &candidate_);
    // Where the model promises no more than the tolerance no further system will be needed.
    const bool finishing = !(step_.predicted_decrease > options_->function_tolerance * cost_);
    if (finishing || last) {
      const double cost = equations_.cost(candidate_, squared_cutoff_);
      report_.converged = finishing;
      if (cost < cost_) accept(cost);
      return;
    }
    lambda_ = std::max(lambda_ * kAfterGoodStep, kMinLambda);
    const auto cost = linearise(candidate_);
    if (!cost) return;
    if (*cost < cost_) {
      report_.converged = cost_ - *cost <= options_->function_tolerance * cost_;
      accept(*cost);
    } else {
      lambda_ /= kAfterGoodStep;
      back_off();
    }
  }

  void accept(double cost) {
    std::swap(state_, candidate_);
    cost_ = cost;
  }

  void back_off() {
    lambda_ *= kAfterBadStep;
    linearise(state_);
  }

  const BundleOptions* options_;
  PointElimination equations_;
  BundleState state_, candidate_;
  BundleStep step_;
  MinimisationReport report_;
  double squared_cutoff_ = 0;
  double cost_ = 0;
  double lambda_ = kFirstLambda;
};

}  // namespace

BundleReport solve_bundle(BundleProblem* problem, const BundleOptions& options) {
  LevenbergMarquardt solver(*problem, options);
  return solve_in_rounds(problem, options, [&](double squared_cutoff, int max_iterations) {
    const MinimisationReport report = solver.minimise(squared_cutoff, max_iterations);
    solver.write_to(problem);
    return report;
  });
}

}  // namespace cairn
