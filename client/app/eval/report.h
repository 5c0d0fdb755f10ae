// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "client/app/eval/metrics.h"
#include "client/app/eval/run_stats.h"

namespace cairn {

/// Reports for people (rows `name value`) and for machines (JSON, one document). Metres, seconds, degrees.
struct RelativeOptions {
  double delta = 1;
  DeltaUnit unit = DeltaUnit::kSeconds;
};

[[nodiscard]] std::string ate_text(const Comparison& comparison, const AbsoluteError& error,
                                   Alignment alignment);
[[nodiscard]] std::string ate_json(const Comparison& comparison, const AbsoluteError& error,
                                   Alignment alignment);
[[nodiscard]] std::string rpe_text(const Comparison& comparison, const RelativeError& error,
                                   Alignment alignment, const RelativeOptions& options);
[[nodiscard]] std::string rpe_json(const Comparison& comparison, const RelativeError& error,
                                   Alignment alignment, const RelativeOptions& options);

struct NamedRun {
  std::string file;
  RunSummary summary;
};
[[nodiscard]] std::string stats_text(const std::vector<NamedRun>& runs);
[[nodiscard]] std::string stats_json(const std::vector<NamedRun>& runs);

}  // namespace cairn
