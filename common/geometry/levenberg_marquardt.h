// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

namespace cairn {

struct LevenbergMarquardtOptions {
  int iterations = 10;  ///< steps that are kept, at most
  int attempts = 4;     ///< at a step, each with more damping than the last
  double first_damping = 1e-4;
  double after_kept = 0.1;                                        ///< the damping is multiplied with it
  double after_refused = 20;                                      ///< likewise
  double least_damping = 0;                                       ///< it gets no smaller
  double most_damping = std::numeric_limits<double>::infinity();  ///< from here on no step is tried
  double least_gain = 1e-6;  ///< share of the cost; a step that gains less is the last
};

/// Moves `state` to a minimum of its cost (Marquardt 1963), never to a higher one. A step that leads to a
/// cost that is not finite gains nothing, and is tried again with more damping like any other that gains
/// nothing.
///   linearize(state)                   the normal equations there; may set what cost() cuts residuals off at
///   step(state, equations, damping)    std::optional<State>, where the step leads whose equations have their
///                                      diagonal multiplied with 1 + damping; nothing if they have no
///                                      solution
///   cost(state)                        cheap: a state that costs time to judge carries its residuals
template <typename State, typename Linearize, typename Step, typename Cost>
void levenberg_marquardt(const LevenbergMarquardtOptions& options, State* state, Linearize linearize,
                         Step step, Cost cost) {
  double damping = options.first_damping;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const auto equations = linearize(std::as_const(*state));
    const double before = cost(std::as_const(*state));
    double gain = 0;
    for (int attempt = 0; attempt < options.attempts && !(gain > 0) && damping < options.most_damping;
         ++attempt) {
      std::optional<State> next = step(std::as_const(*state), equations, damping);
      gain = next ? before - cost(std::as_const(*next)) : 0;
      damping *= gain > 0 ? options.after_kept : options.after_refused;
      damping = std::max(damping, options.least_damping);
      if (gain > 0) *state = std::move(*next);
    }
    if (!(gain >= options.least_gain * before) || !(gain > 0)) break;
  }
}

}  // namespace cairn
