// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>

#include "common/base/time.h"

namespace cairn {

/// Makes of the kernel's stamps, which follow the wall clock, stamps that survive a clock that is set: a
/// wearable without a battery for its clock has it set in mid-run. They count since the Unix epoch by the
/// wall clock of the first reading and go on with the monotonic clock. They never run back and are never of
/// the future. Pure; one for each socket.
class StampClock {
 public:
  /// Both clocks at one time [ns]: since the epoch, and since the start of the machine.
  struct Reading {
    int64_t wall = 0;
    int64_t monotonic = 0;
  };
  /// Reads both clocks now. A thread that is interrupted between them reads them again, so that they hold for
  /// one time.
  [[nodiscard]] static Reading read();

  explicit StampClock(Reading start) : epoch_from_monotonic_(start.wall - start.monotonic) {}

  /// The stamp of a frame that the kernel stamped `wall_stamp` [ns] and that is read `now`.
  [[nodiscard]] Timestamp stamp(int64_t wall_stamp, Reading now);

 private:
  int64_t epoch_from_monotonic_;  ///< [ns]
  Timestamp last_{INT64_MIN};
};

}  // namespace cairn
