// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "client/app/track_options.h"
#include "common/base/log.h"

namespace cairn {

/// Runs `cairn-track` on the caller's thread until the source ends or `stop_requested`; all files are
/// complete when it returns. Result: exit code of DESIGN 10; what went wrong is logged.
[[nodiscard]] int run_tracker(const TrackOptions& options, const Logger& log,
                              const std::function<bool()>& stop_requested);

}  // namespace cairn
