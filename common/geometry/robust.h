// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace cairn {

/// Tukey's cut-off in standard deviations: 95 % as efficient as least squares for normal noise.
inline constexpr double kTukeyCutoffPerSigma = 4.6851;
/// Standard deviation of normal noise over the median of its absolute values.
inline constexpr double kDeviationPerMedian = 1.4826;

/// Tukey's biweight of a squared residual for a squared cut-off: (1 - e^2/c^2)^2 inside, 0 outside.
[[nodiscard]] inline double tukey_weight(double squared_residual, double squared_cutoff) {
  if (squared_residual >= squared_cutoff) return 0.0;
  const double w = 1.0 - squared_residual / squared_cutoff;
  return w * w;
}
/// rho(s): Tukey's cost (s = squared residual), c^2/6 * (1 - (1 - s/c^2)^3) inside, c^2/6 outside. d rho/d s
/// = weight/2.
[[nodiscard]] double tukey_cost(double squared_residual, double squared_cutoff);

/// Squared cut-off by the median of the squared residuals (PTAM r114): (kTukeyCutoffPerSigma *
/// kDeviationPerMedian * (1 + 5/(2n - 6)))^2 * median, the small-sample factor capped for n < 6. Reorders
/// `squared_residuals`; 0 for none.
[[nodiscard]] double tukey_squared_cutoff(std::span<double> squared_residuals);

}  // namespace cairn
