// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "common/base/time.h"

namespace cairn {

/// What the records of the store are dated by.
[[nodiscard]] inline Timestamp wall_time() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()};
}

}  // namespace cairn
