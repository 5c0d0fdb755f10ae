// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "common/base/time.h"
#include "hw/can/xsens.h"

namespace cairn {

/// Watches whether the IMU is there and samples as often as the configuration says. Its rate is told by its
/// own clock and counter, so that lost frames do not change it. Pure.
class ImuWatch {
 public:
  /// `rate_off`: of the rate; a larger error is a wrong one.
  ImuWatch(double rate, double rate_off, std::chrono::milliseconds deadline, MonotonicTime now)
      : rate_(rate), rate_off_(rate_off), deadline_(deadline), heard_(now) {}

  void receive(const xsens::Message& message, MonotonicTime now);

  [[nodiscard]] bool is_silent(MonotonicTime now) const { return now - heard_ > deadline_; }
  [[nodiscard]] bool is_at_wrong_rate() const;
  /// The rate measured over half a second [Hz]; nothing before.
  [[nodiscard]] std::optional<double> measured_rate() const { return measured_; }

 private:
  struct Mark {
    uint32_t ticks;
    uint16_t count;
  };
  void count(uint16_t sample);

  double rate_;
  double rate_off_;
  std::chrono::milliseconds deadline_;
  MonotonicTime heard_;
  std::optional<uint32_t> ticks_;  ///< of the sample whose counter is to come
  std::optional<Mark> begin_;
  std::optional<double> measured_;
};

}  // namespace cairn
