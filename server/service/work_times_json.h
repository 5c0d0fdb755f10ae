// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "server/service/work_times.h"

namespace cairn {

/// Writes summaries as JSON for `--stats`: `{"offer_waited_ms": {"count", "p50", "p95", "p99", "max"},
/// "local_adjustment_cpu_ms": ...}`.
[[nodiscard]] std::string to_json(const std::vector<WorkSummary>& summaries);

}  // namespace cairn
