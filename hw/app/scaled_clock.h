// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>

#include "common/base/time.h"

namespace cairn {

/// Of the wall clock, which is that of stamps on the wire.
[[nodiscard]] inline Timestamp wall_time() {
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(
              std::chrono::system_clock::now().time_since_epoch())
              .count()};
}

/// The clock of a rig and its simulated devices: that of the machine, or one that is slower by a whole
/// factor, for machines too slow for a rig. All deadlines are by it. Clocks of the same factor in different
/// processes agree.
class ScaledClock {
 public:
  explicit ScaledClock(int factor = 1) : factor_(factor) {}

  [[nodiscard]] MonotonicTime now() const {
    return MonotonicTime(std::chrono::steady_clock::now().time_since_epoch() / factor_);
  }
  /// When, by this clock, the wall clock showed that.
  [[nodiscard]] MonotonicTime at(Timestamp wall) const {
    return now() - std::chrono::duration_cast<MonotonicTime::duration>((wall_time() - wall) / factor_);
  }
  /// Of the machine, from now until `time` of this clock; 0 where that has been.
  [[nodiscard]] std::chrono::nanoseconds until(MonotonicTime time) const {
    return std::max(time - now(), std::chrono::steady_clock::duration(0)) * factor_;
  }
  [[nodiscard]] int factor() const { return factor_; }

 private:
  int factor_;
};

}  // namespace cairn
