// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>

#include "common/base/time.h"

namespace cairn {

/// The clock of a rig and its simulated devices: that of the machine, or one that is slower by a whole
/// factor, for machines too slow for a rig. All deadlines and stamps are by it. Clocks of the same factor in
/// different processes agree.
class ScaledClock {
 public:
  explicit ScaledClock(int factor = 1) : factor_(factor) {}

  [[nodiscard]] MonotonicTime now() const {
    return MonotonicTime(std::chrono::steady_clock::now().time_since_epoch() / factor_);
  }
  /// The time for stamps on the wire, by a wall clock that is as slow.
  [[nodiscard]] Timestamp wall_time() const {
    const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
    return of_wall({std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()});
  }
  /// The time of that wall clock at a time of the machine's own.
  [[nodiscard]] Timestamp of_wall(Timestamp time) const { return {time.nanoseconds / factor_}; }
  /// The time by now() at which wall_time() was `stamp`.
  [[nodiscard]] MonotonicTime at(Timestamp stamp) const {
    return now() - std::chrono::duration_cast<MonotonicTime::duration>(wall_time() - stamp);
  }
  /// How long, by the machine's clock, it is from now until `time` of this clock; 0 where that has been.
  [[nodiscard]] std::chrono::nanoseconds until(MonotonicTime time) const {
    return std::max(time - now(), std::chrono::steady_clock::duration(0)) * factor_;
  }

 private:
  int factor_;
};

}  // namespace cairn
