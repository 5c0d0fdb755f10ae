// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "server/service/clock.h"

namespace cairn {

/// This machine's.
class SystemClock : public Clock {
 public:
  [[nodiscard]] MonotonicTime now() const override { return std::chrono::steady_clock::now(); }
  [[nodiscard]] Timestamp wall() const override {
    const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
    return {std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()};
  }
};

}  // namespace cairn
