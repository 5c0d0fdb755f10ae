// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace cairn {

/// Real roots of c[0] + c[1] x + c[2] x^2 + ... in [low, high], ascending, where the polynomial changes sign
/// (roots of even multiplicity may be left out). By bisection between the roots of the derivative, to the
/// last bits of `high`.
[[nodiscard]] std::vector<double> sign_changes(std::span<const double> coefficients, double low, double high);

/// The first of sign_changes(), if any.
[[nodiscard]] std::optional<double> first_sign_change(std::span<const double> coefficients, double low,
                                                      double high);

}  // namespace cairn
