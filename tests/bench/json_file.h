// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "common/base/stream_writer.h"
#include "common/io/json_text.h"
#include "tests/bench/timing.h"

namespace cairn {

/// Writes what a benchmark has measured, for `write-figures`; an empty path: nothing. Error kIo.
[[nodiscard]] inline Status write_figures(const std::string& path, const nlohmann::json& figures) {
  return path.empty() ? Status() : write_stream(path, json_text(figures, 1) + "\n");
}

/// Median and tails, in the unit of the values; null where there are none.
[[nodiscard]] inline nlohmann::json spread_json(const std::vector<double>& values) {
  if (values.empty()) return {{"count", 0}, {"p50", nullptr}, {"p95", nullptr}, {"p99", nullptr}};
  return {{"count", values.size()},
          {"p50", percentile(values, 0.5)},
          {"p95", percentile(values, 0.95)},
          {"p99", percentile(values, 0.99)}};
}

}  // namespace cairn
