// SPDX-License-Identifier: Apache-2.0
#include "hw/can/stamp_clock.h"

#include <algorithm>
#include <limits>

namespace cairn {
namespace {

constexpr int kMostReadings = 5;
constexpr int64_t kQuickReading = 10'000;  ///< [ns], a hundred times what it takes

template <typename Clock>
int64_t nanoseconds() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

}  // namespace

StampClock::Reading StampClock::read() {
  Reading best;
  int64_t least_taken = std::numeric_limits<int64_t>::max();
  for (int i = 0; i < kMostReadings && least_taken > kQuickReading; ++i) {
    const int64_t before = nanoseconds<std::chrono::steady_clock>();
    const int64_t wall = nanoseconds<std::chrono::system_clock>();
    const int64_t taken = nanoseconds<std::chrono::steady_clock>() - before;
    if (taken >= least_taken) continue;
    least_taken = taken;
    best = {wall, before + taken / 2};
  }
  return best;
}

Timestamp StampClock::stamp(int64_t wall_stamp, Reading now) {
  const Timestamp read_at{now.monotonic + epoch_from_monotonic_};
  // Only what was queued while the clock was set has a wrong age; between its neighbours it does no harm.
  const int64_t age = std::max<int64_t>(0, now.wall - wall_stamp);
  last_ = std::clamp(read_at + -std::chrono::nanoseconds(age), std::min(last_, read_at), read_at);
  return last_;
}

}  // namespace cairn
