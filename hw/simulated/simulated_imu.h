// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <random>
#include <vector>

#include "common/base/time.h"
#include "hw/can/frame.h"
#include "hw/can/xsens.h"

namespace cairn::simulated {

/// The motion of the IMU, in its own axes.
struct ImuMotion {
  std::array<double, 3> rate{};                           ///< [rad/s]
  std::array<double, 3> acceleration{0.0, 0.0, 9.80665};  ///< [m/s^2], with the pull that holds it up
};

struct ImuOptions {
  xsens::Ids ids;
  double frequency = 100;            ///< of samples, 100 to 400 [Hz]
  double rate_noise = 0.003;         ///< standard deviation of a sample [rad/s]
  double rate_bias = 0.005;          ///< standard deviation of what stays the same for a run [rad/s]
  double acceleration_noise = 0.02;  ///< likewise [m/s^2]
  double acceleration_bias = 0.03;
};

/// An Xsens MTi-600 on the bus, in simulated time: sample time, counter, rate of turn and acceleration, both
/// as the mean since the sample before, as a device's strapdown integration gives them. Same options, seed
/// and calls, same frames.
class SimulatedImu {
 public:
  SimulatedImu(const ImuOptions& options, uint32_t seed, MonotonicTime now);

  /// The motion from here on.
  void move(const ImuMotion& motion) { motion_ = motion; }
  /// Goes on to `now`, and appends what it sends meanwhile.
  void advance(MonotonicTime now, std::vector<CanFrame>& out);
  /// Fault: sends nothing, as with its plug pulled; its clock goes on.
  void mute(bool muted) { muted_ = muted; }
  /// Fault: samples at another frequency [Hz] from the next one on.
  void set_frequency(double frequency);

  [[nodiscard]] const std::array<double, 3>& rate_bias() const { return rate_bias_; }
  [[nodiscard]] const std::array<double, 3>& acceleration_bias() const { return acceleration_bias_; }

 private:
  void sample(std::vector<CanFrame>& out);
  void integrate(MonotonicTime until);

  ImuOptions options_;
  std::mt19937 random_;
  std::chrono::nanoseconds period_{};
  MonotonicTime start_;
  MonotonicTime next_;
  ImuMotion motion_;
  ImuMotion integral_{{}, {}};  ///< since the newest sample
  MonotonicTime began_;         ///< of the integral
  MonotonicTime integrated_;
  std::array<double, 3> rate_bias_{};
  std::array<double, 3> acceleration_bias_{};
  uint16_t count_ = 0;
  bool muted_ = false;
};

}  // namespace cairn::simulated
