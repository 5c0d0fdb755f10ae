// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/polynomial.h"

#include <algorithm>

namespace cairn {
namespace {

double value_at(std::span<const double> coefficients, double x) {
  double value = 0;
  for (size_t i = coefficients.size(); i-- > 0;) value = value * x + coefficients[i];
  return value;
}

/// The root in an interval over whose ends the sign differs.
double bisect(std::span<const double> coefficients, double low, double high) {
  constexpr int kHalvings = 100;  // ends earlier: when no double is left between the ends
  const bool rising = value_at(coefficients, low) <= 0;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    ((value_at(coefficients, middle) <= 0) == rising ? low : high) = middle;
  }
  return low;
}

}  // namespace

std::vector<double> sign_changes(std::span<const double> coefficients, double low, double high) {
  while (!coefficients.empty() && coefficients.back() == 0) {
    coefficients = coefficients.first(coefficients.size() - 1);
  }
  if (coefficients.size() < 2 || !(low < high)) return {};
  std::vector<double> derivative;
  for (size_t i = 1; i < coefficients.size(); ++i) {
    derivative.push_back(static_cast<double>(i) * coefficients[i]);
  }
  // Between turning points the polynomial is monotonic: at most one root in each stretch.
  std::vector<double> stops = sign_changes(derivative, low, high);
  stops.push_back(high);
  std::vector<double> roots;
  double from = low;
  for (const double to : stops) {
    if ((value_at(coefficients, from) <= 0) != (value_at(coefficients, to) <= 0)) {
      roots.push_back(bisect(coefficients, from, to));
    }
    from = to;
  }
  return roots;
}

std::optional<double> first_sign_change(std::span<const double> coefficients, double low, double high) {
  const auto roots = sign_changes(coefficients, low, high);
  return roots.empty() ? std::nullopt : std::optional<double>(roots.front());
}

}  // namespace cairn
