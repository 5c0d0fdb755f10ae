// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "common/bundle/bundle.h"

/// What all ways of solving a bundle problem share: rounds of robust scale, and the judgement of the result.
namespace cairn {

struct MinimizationReport {
  bool usable = false;
  bool converged = false;
  bool stopped = false;  ///< by should_stop
  int iterations = 0;
};

/// Minimizes the sum of tukey_cost() at a cut-off, in place, in at most so many iterations.
using Minimization = std::function<MinimizationReport(double squared_cutoff, int max_iterations)>;

BundleReport solve_in_rounds(BundleProblem* problem, const BundleOptions& options,
                             const Minimization& minimize);

}  // namespace cairn
