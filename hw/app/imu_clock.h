// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "common/base/time.h"

namespace cairn {

/// Tells when a sample of the IMU was taken by the host's clock, which is the camera's: the IMU counts its
/// own time, and each frame comes some time after its sample. The least of these times within the last
/// seconds is taken for the way on an idle bus, so that a late frame makes no late sample; a drift of 100 ppm
/// between the clocks makes 0.2 ms. Pure.
class ImuClock {
 public:
  /// A sample taken at `ticks` (of 0.1 ms; they wrap), whose frame was received then.
  void receive(uint32_t ticks, Timestamp received);

  /// [ns] What must be added to the IMU's own time to get the host's; nothing before the first sample.
  [[nodiscard]] std::optional<int64_t> offset() const;
  /// When the newest sample was taken, by the host's clock. Only where there is an offset().
  [[nodiscard]] Timestamp newest() const { return {own_time_ + offset().value_or(0)}; }

 private:
  std::optional<uint32_t> ticks_;
  int64_t own_time_ = 0;  ///< of the IMU, without wrapping [ns]
  int64_t begin_ = 0;     ///< of the present second, in the same
  std::optional<int64_t> least_;
  std::optional<int64_t> least_before_;  ///< of the second before
};

}  // namespace cairn
