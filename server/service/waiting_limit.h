// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "server/service/service_context.h"

namespace cairn {

/// Why `more` [bytes] of a seed, a keyframe or a proposal may not wait to be judged beside what waits already
/// of all clients; empty: they may.
[[nodiscard]] inline std::string why_too_much_waits(const ServiceContext& context, size_t waiting,
                                                    size_t more) {
  if (waiting + more <= context.options.max_waiting_bytes) return {};
  return "too much waits to be judged: all that clients have offered (maps begun, keyframes, proposals) may "
         "take " +
         std::to_string(context.options.max_waiting_bytes / 1'000'000) + " MB";
}

}  // namespace cairn
