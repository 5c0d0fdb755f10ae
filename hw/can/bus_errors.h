// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace cairn {

/// A fault that a controller reports of itself and of its bus, in ISO 11898-1's terms.
enum class BusFault : uint8_t {
  kTransmitTimeout,   ///< the driver gave up a frame
  kArbitrationLost,   ///< a more urgent frame went first: normal on a busy bus
  kReceiveOverflow,   ///< the controller had no room for a frame
  kTransmitOverflow,  ///< likewise, on the way out
  kErrorWarning,      ///< an error counter is above 96
  kErrorPassive,      ///< an error counter is above 127
  kErrorActive,       ///< the counters are low again
  kProtocol,          ///< a bit, stuff, form or CRC error
  kTransceiver,       ///< the wires: open or shorted, as far as the transceiver tells
  kNoAcknowledge,     ///< no other node has taken the frame
  kBusOff,            ///< the controller has left the bus
  kBusError,          ///< an error of a kind that the driver does not tell
  kRestarted,         ///< the controller is back after bus-off
};
constexpr size_t kBusFaultKinds = static_cast<size_t>(BusFault::kRestarted) + 1;

/// The content of an error frame.
struct BusErrors {
  uint16_t faults = 0;  ///< one bit for each BusFault
  /// The controller's error counters, where the driver tells them.
  struct Counters {
    uint8_t transmit = 0;
    uint8_t receive = 0;
    bool operator==(const Counters&) const = default;
  };
  std::optional<Counters> counters;
  bool operator==(const BusErrors&) const = default;

  [[nodiscard]] bool has(BusFault fault) const { return (faults >> static_cast<unsigned>(fault) & 1U) != 0; }
  void add(BusFault fault) { faults = static_cast<uint16_t>(faults | 1U << static_cast<unsigned>(fault)); }
};

/// Decodes an error frame of the kernel (linux/can/error.h): the bits of its identifier and its eight bytes.
[[nodiscard]] BusErrors decode_error_frame(uint32_t error_class, const std::array<uint8_t, 8>& data);

[[nodiscard]] const char* name_of(BusFault fault);
/// "bus-off, no acknowledge (transmit errors 128, receive errors 0)".
[[nodiscard]] std::string describe(const BusErrors& errors);

}  // namespace cairn
