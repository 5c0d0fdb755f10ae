// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace cairn::wire {

/// [bytes] Of why something is refused. Who receives a longer one does not take the message.
inline constexpr size_t kMaxReasonBytes = 1024;

}  // namespace cairn::wire
