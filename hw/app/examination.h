// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "hw/app/interface_facts.h"
#include "hw/can/can_bus.h"
#include "hw/can/odrive.h"
#include "hw/can/xsens.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

struct Check {
  bool passed = false;
  std::string what;  ///< in words, with the remedy where it failed
};

/// The checks of an interface as the kernel tells of it, in the order of bring-up.
[[nodiscard]] std::vector<Check> check_interface(const std::string& name,
                                                 const Result<InterfaceFacts>& facts);

/// Tells what is on a bus, from the frames that come within some time: whether that is the rig of the
/// configuration. Nothing is sent and nothing moves. Pure.
class Examination {
 public:
  explicit Examination(const RigConfiguration& configuration) : configuration_(configuration) {}

  void receive(const CanFrame& frame);
  /// Drives, then the IMU, then frames that are no messages, then the load of the bus (where its bit rate is
  /// known), as of frames that came within `listened`.
  [[nodiscard]] std::vector<Check> conclude(std::chrono::duration<double> listened,
                                            std::optional<uint32_t> bit_rate) const;

 private:
  struct Drive {
    int heartbeats = 0;
    int estimates = 0;
    uint32_t errors = 0;  ///< of the newest heartbeat
  };

  void check_drive(AxisName name, double listened, std::vector<Check>* checks) const;
  void check_strange(std::vector<Check>* checks) const;
  void check_imu(double listened, std::vector<Check>* checks) const;
  [[nodiscard]] std::string other_nodes() const;

  RigConfiguration configuration_;
  std::map<odrive::Node, Drive> drives_;  ///< all that sent a heartbeat or estimates
  std::array<int, std::variant_size_v<xsens::Message>> imu_{};
  uint64_t bits_ = 0;
  uint64_t strange_frames_ = 0;
  std::optional<CanFrame> strange_;  ///< the newest that is no message of any drive or IMU
};

}  // namespace cairn
