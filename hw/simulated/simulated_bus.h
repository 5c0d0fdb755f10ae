// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>
#include <random>
#include <vector>

#include "common/base/time.h"
#include "hw/can/can_bus.h"
#include "hw/simulated/simulated_drive.h"
#include "hw/simulated/simulated_imu.h"

namespace cairn::simulated {

/// A CAN bus in simulated time with drives and an IMU on it, as the host at its other end sees it: what is
/// tested with it knows its devices by their frames alone. Each frame takes its time on the wire. The stamps
/// of received frames count from the beginning. One thread.
class SimulatedBus final : public CanBus {
 public:
  SimulatedBus(const std::vector<DriveOptions>& drives, const ImuOptions& imu, uint32_t seed,
               MonotonicTime now);

  /// Devices and wire go on to `now`.
  void advance(MonotonicTime now);

  // Faults.
  /// Sets the share of frames that are lost, in either direction: 0 to 1.
  void drop(double share) { dropped_share_ = share; }
  /// The host's controller has left the bus, or is back.
  void set_bus_off(bool off);

  [[nodiscard]] SimulatedDrive& drive(size_t index) { return drives_.at(index); }
  [[nodiscard]] SimulatedImu& imu() { return imu_; }

  using CanBus::send;
  SendOutcome send(const CanFrame& frame, Urgency urgency) override;
  [[nodiscard]] std::optional<ReceivedFrame> receive() override;
  [[nodiscard]] int descriptor() const override { return -1; }
  [[nodiscard]] std::optional<MonotonicTime> retry_at() const override;
  [[nodiscard]] const BusHealth& health() const override { return health_; }

 private:
  struct OnTheWire {
    MonotonicTime arrival;
    CanFrame frame;
  };

  void put(const CanFrame& frame, std::deque<OnTheWire>& wire);
  [[nodiscard]] bool is_lost();
  void deliver();

  std::mt19937 random_;
  MonotonicTime start_;
  MonotonicTime now_;
  std::vector<SimulatedDrive> drives_;
  SimulatedImu imu_;
  std::deque<OnTheWire> to_devices_;
  std::deque<OnTheWire> to_host_;
  double dropped_share_ = 0;
  BusHealth health_;
};

}  // namespace cairn::simulated
