// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/robust.h"

#include <algorithm>

#include "common/base/median.h"

namespace cairn {

double tukey_cost(double squared_residual, double squared_cutoff) {
  const double asymptote = squared_cutoff / 6;
  if (squared_residual >= squared_cutoff) return asymptote;
  const double w = 1 - squared_residual / squared_cutoff;
  return asymptote * (1 - w * w * w);
}

double tukey_squared_cutoff(std::span<double> squared_residuals) {
  if (squared_residuals.empty()) return 0;
  const double median = reorder_to_median(squared_residuals);
  // 2n - 6 vanishes at n = 3; below six residuals the factor of six is as good as any.
  const double n = std::max<double>(static_cast<double>(squared_residuals.size()), 6);
  const double cutoff_per_sigma = kTukeyCutoffPerSigma * kDeviationPerMedian * (1 + 5 / (2 * n - 6));
  return cutoff_per_sigma * cutoff_per_sigma * median;
}

}  // namespace cairn
