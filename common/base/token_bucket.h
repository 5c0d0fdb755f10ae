// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>

namespace cairn {

/// A token bucket: grants `per_second` a second in the long run, and at most `at_once` at once. The time is
/// handed in. One thread.
class TokenBucket {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  /// `per_second` 0: no limit.
  TokenBucket(double per_second, double at_once)
      : per_second_(per_second), at_once_(at_once), left_(at_once) {}

  /// Whether one more is within the limit; it counts then.
  [[nodiscard]] bool take(TimePoint now) {
    if (per_second_ <= 0) return true;
    if (last_ && now > *last_)
      left_ = std::min(at_once_, left_ + per_second_ * std::chrono::duration<double>(now - *last_).count());
    if (!last_ || now > *last_) last_ = now;
    if (left_ < 1) return false;
    left_ -= 1;
    return true;
  }

 private:
  double per_second_;
  double at_once_;
  double left_;
  std::optional<TimePoint> last_;
};

}  // namespace cairn
