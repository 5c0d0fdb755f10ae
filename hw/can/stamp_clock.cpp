// SPDX-License-Identifier: Apache-2.0
#include "hw/can/stamp_clock.h"

#include <algorithm>

namespace cairn {

StampClock::Reading StampClock::read() {
  const auto nanoseconds = [](auto since) {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(since.time_since_epoch()).count();
  };
  return {nanoseconds(std::chrono::system_clock::now()), nanoseconds(std::chrono::steady_clock::now())};
}

Timestamp StampClock::stamp(int64_t wall_stamp, Reading now) {
  const Timestamp read_at{now.monotonic + epoch_from_monotonic_};
  // Only what was queued while the clock was set has a wrong age; between its neighbours it does no harm.
  const int64_t age = std::max<int64_t>(0, now.wall - wall_stamp);
  last_ = std::clamp(read_at + -std::chrono::nanoseconds(age), std::min(last_, read_at), read_at);
  return last_;
}

}  // namespace cairn
