// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <vector>

#include "common/base/cpu_time.h"

namespace cairn {

[[nodiscard]] inline double thread_cpu_ms() {
  return std::chrono::duration<double, std::milli>(thread_cpu_time()).count();
}

/// p in 0..1; 0 for no values.
[[nodiscard]] inline double percentile(std::vector<double> values, double p) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(p * static_cast<double>(values.size() - 1))];
}

}  // namespace cairn
