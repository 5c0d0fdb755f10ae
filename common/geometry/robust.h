// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace cairn {

/// Tukey's biweight of a squared residual for a squared cut-off: (1 - e^2/c^2)^2 inside, 0 outside.
[[nodiscard]] inline double tukey_weight(double squared_residual, double squared_cutoff) {
  if (squared_residual >= squared_cutoff) return 0.0;
  const double w = 1.0 - squared_residual / squared_cutoff;
  return w * w;
}
/// rho(s): Tukey's cost (s = squared residual), c^2/6 * (1 - (1 - s/c^2)^3) inside, c^2/6 outside. d rho/d s
/// = weight/2.
[[nodiscard]] double tukey_cost(double squared_residual, double squared_cutoff);

/// Squared cut-off by the median of the squared residuals (PTAM r114): (4.6851 * 1.4826 * (1 + 5/(2n - 6)))^2
/// * median, the small-sample factor capped for n < 6. Reorders `squared_residuals`; 0 for none.
[[nodiscard]] double tukey_squared_cutoff(std::span<double> squared_residuals);

}  // namespace cairn
