// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

namespace cairn {

/// Says whether words that a fault would repeat many times a second are due again. One thread.
class RateLimit {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  explicit RateLimit(std::chrono::milliseconds interval = std::chrono::seconds(5)) : interval_(interval) {}

  [[nodiscard]] bool due(TimePoint now = std::chrono::steady_clock::now()) {
    if (last_ && now - *last_ < interval_) return false;
    last_ = now;
    return true;
  }

 private:
  std::chrono::milliseconds interval_;
  std::optional<TimePoint> last_;
};

}  // namespace cairn
