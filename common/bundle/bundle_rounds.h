// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "common/bundle/bundle.h"

/// What all ways of solving a bundle problem share: rounds of robust scale, and the judgement of the result.
namespace cairn {

struct MinimisationReport {
  bool usable = false;
  bool converged = false;
  bool stopped = false;  ///< by should_stop
  int iterations = 0;
};

/// Minimises the sum of tukey_cost() at a cut-off, in place, in at most so many iterations.
using Minimisation = std::function<MinimisationReport(double squared_cutoff, int max_iterations)>;

BundleReport solve_in_rounds(BundleProblem* problem, const BundleOptions& options,
                             const Minimisation& minimise);

}  // namespace cairn
