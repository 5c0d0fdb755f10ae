// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/bundle.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "common/bundle/bundle_rounds.h"
#include "common/bundle/schur_complement.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

// With one fixed pose the scale is free: without some damping the reduced system is singular.
constexpr double kMinLambda = 1e-8;
constexpr double kFirstLambda = 1e-4;
constexpr double kMaxLambda = 1e8;
constexpr double kAfterGoodStep = 0.1;
constexpr double kAfterBadStep = 10;

using Outcome = ReducedSystem::Outcome;

/// The factor that turns the inverse of the weighted normal equations into a covariance: E psi^2 / (E psi')^2
/// * E w for psi = w r, w Tukey's weight (Huber 1981, 7.6), the first corrected for the parameters fitted.
double estimator_variance(const BundleProblem& problem, double squared_cutoff) {
  double psi_squared = 0;
  double psi_slope = 0;
  double weights = 0;
  double count = 0;
  for (const double s : squared_residuals(problem)) {
    if (!(s < squared_cutoff)) continue;
    const double w = tukey_weight(s, squared_cutoff);
    psi_squared += w * w * s;
    psi_slope += 2 * (w - 2 * s / squared_cutoff * (1 - s / squared_cutoff));
    weights += 2 * w;
    count += 2;
  }
  const auto moving =
      std::count_if(problem.poses.begin(), problem.poses.end(), [](const BundlePose& p) { return !p.fixed; });
  const auto still = std::count(problem.fixed_points.begin(), problem.fixed_points.end(), true);
  const double parameters =
      kPointSize * static_cast<double>(problem.points.size() - static_cast<size_t>(still)) +
      kPoseSize * static_cast<double>(moving) +
      kIntrinsics * static_cast<double>(problem.free_cameras.size());
  const double freedom = count - parameters;
  if (!(freedom > 0 && psi_slope > 0)) return std::numeric_limits<double>::infinity();
  return psi_squared / freedom * (weights * count) / (psi_slope * psi_slope);
}

/// Levenberg-Marquardt. A candidate's cost and the system for the step after it come from one pass over the
/// observations, in the hope, rarely wrong, that the candidate is better.
class LevenbergMarquardt {
 public:
  LevenbergMarquardt(const BundleProblem& problem, const BundleOptions& options)
      : options_(&options), equations_(problem, best_tile_kernels()) {
    for (const BundlePose& p : problem.poses) state_.poses.push_back(p.camera_from_map);
    state_.points = problem.points;
    for (const FreeCamera& c : problem.free_cameras) state_.free_cameras.push_back(c.camera);
  }

  MinimizationReport minimize(double squared_cutoff, int max_iterations) {
    report_ = {.usable = true};
    squared_cutoff_ = squared_cutoff;
    lambda_ = kFirstLambda;
    const auto start = linearize(state_);
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
    for (size_t i = 0; i < state_.free_cameras.size(); ++i)
      problem->free_cameras[i].camera = state_.free_cameras[i];
    for (BundlePose& p : problem->poses) {
      if (p.free_camera >= 0) p.camera = state_.free_cameras[static_cast<size_t>(p.free_camera)];
    }
  }

  /// Writes the covariances of the free cameras at the state reached. They keep their old ones when
  /// should_stop ends the computation, and when the equations are singular.
  void write_covariances_to(BundleProblem* problem, double squared_cutoff) {
    const auto inverse = equations_.camera_covariances(state_, squared_cutoff, options_->should_stop);
    if (!inverse) return;
    const double variance = estimator_variance(*problem, squared_cutoff);
    for (size_t i = 0; i < inverse->size(); ++i)
      problem->free_cameras[i].covariance = variance * (*inverse)[i];
  }

 private:
  std::optional<double> linearize(const BundleState& state) {
    const auto cost = equations_.linearize(state, squared_cutoff_, lambda_, options_->should_stop);
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
    const auto cost = linearize(candidate_);
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
    linearize(state_);
  }

  const BundleOptions* options_;
  SchurComplement equations_;
  BundleState state_, candidate_;
  BundleStep step_;
  MinimizationReport report_;
  double squared_cutoff_ = 0;
  double cost_ = 0;
  double lambda_ = kFirstLambda;
};

}  // namespace

BundleReport solve_bundle(BundleProblem* problem, const BundleOptions& options) {
  LevenbergMarquardt solver(*problem, options);
  BundleReport report = solve_in_rounds(problem, options, [&](double squared_cutoff, int max_iterations) {
    const MinimizationReport minimized = solver.minimize(squared_cutoff, max_iterations);
    solver.write_to(problem);
    return minimized;
  });
  if (report.usable && !problem->free_cameras.empty())
    solver.write_covariances_to(problem, report.squared_cutoff);
  return report;
}

}  // namespace cairn
