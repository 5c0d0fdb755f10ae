// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "client/app/track_options.h"
#include "common/base/log.h"

namespace cairn {

/// What the user asks for while it runs. Called on the thread of run_tracker().
struct RunSignals {
  std::function<bool()> stop_requested;
  std::function<bool()> new_map_requested;
};

/// Runs `cairn-track` on the caller's thread until the source ends or a stop is requested; all files are
/// complete when it returns. Result: exit code as in client/app/README.md; what went wrong is logged.
[[nodiscard]] int run_tracker(const TrackOptions& options, const Logger& log, const RunSignals& signals);

}  // namespace cairn
