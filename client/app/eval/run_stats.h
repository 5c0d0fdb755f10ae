// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "common/base/histogram.h"
#include "common/base/result.h"

namespace cairn {

struct Percentiles {
  double p50 = 0;
  double p95 = 0;
  double p99 = 0;
};

/// What a `cairn-track --stats` file says of a run.
struct RunSummary {
  int64_t frames_total = 0;
  std::optional<int64_t> first_map_frame;  ///< nothing: no map came about
  int64_t frames_after_map = 0;            ///< the first map's frame and all after it, dropped ones too
  // Counted over frames_after_map:
  int64_t tracked = 0;  ///< states `tracking` and `poor`
  int64_t poor = 0;
  int64_t lost = 0;
  int64_t dropped = 0;
  double tracked_percent = 0;
  // Over the whole run:
  int64_t switches = 0;
  int64_t bytes_sent = 0;
  int64_t bytes_received = 0;
  double on_time_percent =
      0;               ///< of all frames of the source: wall_ms <= kOnTimeMs, not dropped and not lost
  Percentiles cpu_ms;  ///< over tracked frames, as in the file itself
  Percentiles wall_ms;
};

/// Reads a --stats document. kDamaged, with the name of the field, when it is not one.
[[nodiscard]] Result<RunSummary> summarize_run(std::string_view json);

}  // namespace cairn
