// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>

namespace cairn {

/// The clock of leases and time-outs.
using MonotonicTime = std::chrono::steady_clock::time_point;

/// Capture time of a frame: nanoseconds since the Unix epoch (recordings: since whatever their own zero is).
/// A distinct type, so that it never mixes with the monotonic clock of leases and time-outs.
struct Timestamp {
  int64_t nanoseconds = 0;
  auto operator<=>(const Timestamp&) const = default;

  [[nodiscard]] double seconds() const { return static_cast<double>(nanoseconds) * 1e-9; }
  [[nodiscard]] static Timestamp from_seconds(double s) {
    return {static_cast<int64_t>(s * 1e9 + (s >= 0 ? 0.5 : -0.5))};
  }
};

inline std::chrono::nanoseconds operator-(Timestamp a, Timestamp b) {
  return std::chrono::nanoseconds(a.nanoseconds - b.nanoseconds);
}
inline Timestamp operator+(Timestamp a, std::chrono::nanoseconds d) {
  return {a.nanoseconds + d.count()};
}

/// The time since the Unix epoch by the system's clock, for what goes by the calendar.
[[nodiscard]] inline Timestamp wall_clock_now() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()};
}

/// Seconds from b to a.
inline double seconds_between(Timestamp a, Timestamp b) {
  return static_cast<double>(a.nanoseconds - b.nanoseconds) * 1e-9;
}

}  // namespace cairn
