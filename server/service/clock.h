// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/base/time.h"

namespace cairn {

/// What time it is, handed in, so that a test or a simulation has a time of its own. Thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;
  /// Time for leases, patience and intervals.
  [[nodiscard]] virtual MonotonicTime now() const = 0;
  /// Time by which the records of the store are dated.
  [[nodiscard]] virtual Timestamp wall() const = 0;
};

}  // namespace cairn
