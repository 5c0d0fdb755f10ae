// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "common/base/time.h"

namespace cairn {

/// What time it is, handed in, so that a test or a simulation has a time of its own. Thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;
  /// For leases, patience and intervals.
  [[nodiscard]] virtual MonotonicTime now() const = 0;
  /// For what the records of the store are dated by.
  [[nodiscard]] virtual Timestamp wall() const = 0;
};

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
