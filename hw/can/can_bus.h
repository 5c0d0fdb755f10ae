// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/time.h"
#include "hw/can/bus_errors.h"
#include "hw/can/frame.h"

namespace cairn {

/// The state of a bus: what stands in the way of frames, the worst where there are several.
enum class BusCondition : uint8_t {
  kUp,             ///< frames go and come
  kErrorPassive,   ///< frames go, many of them wrong or without acknowledge
  kQueueFull,      ///< the kernel's transmit queue has no room
  kBusOff,         ///< the controller has left the bus because of its errors
  kInterfaceDown,  ///< the interface is there and not up
  kInterfaceGone,  ///< there is no interface of that name
  kFault,          ///< the system refuses with another reason
};

/// Condition and counters of a bus since it was opened.
struct BusHealth {
  BusCondition condition = BusCondition::kUp;
  int system_error = 0;  ///< errno of kFault, else 0
  uint64_t sent = 0;
  uint64_t received = 0;
  uint64_t withheld = 0;  ///< frames that send() did not hand to the kernel, or that it did not take
  uint64_t lost = 0;      ///< received frames that found the socket's queue full
  uint64_t error_frames = 0;
  uint64_t arbitration_lost = 0;
  uint64_t no_acknowledge = 0;
  uint64_t bus_off = 0;   ///< times that the controller left the bus
  uint64_t restored = 0;  ///< times that the interface came back
  BusErrors last_errors;  ///< of the newest error frame
};

/// Says in one line the interface, what is wrong with it and what helps; empty when nothing is.
[[nodiscard]] std::string describe(const BusHealth& health, std::string_view interface_name);

enum class [[nodiscard]] SendOutcome : uint8_t{
    kQueued,    ///< the kernel has it; whether another node takes it is not known
    kWithheld,  ///< nobody has it nor will have it later; health() says why
    kInvalid,   ///< no bus, or not this one, carries such a frame (CAN FD on a classic interface)
};

enum class Urgency : uint8_t {
  kRoutine,  ///< withheld without a try while the bus backs off
  kUrgent,   ///< tried in any case: an emergency stop, repeated until it is queued
};

/// A CAN bus as one node sees it. Nothing of it blocks, and no fault of the bus ends it: it backs off, tries
/// again and says in health() what is the matter. A frame that cannot go now is withheld, never kept:
/// setpoints of a second ago must not reach a drive. One thread.
class CanBus {
 public:
  CanBus() = default;
  virtual ~CanBus() = default;
  CanBus(const CanBus&) = delete;
  CanBus& operator=(const CanBus&) = delete;

  virtual SendOutcome send(const CanFrame& frame, Urgency urgency) = 0;
  SendOutcome send(const CanFrame& frame) { return send(frame, Urgency::kRoutine); }
  /// The next frame that came, if any. It also does what is due to get the bus back, so it is called at
  /// retry_at() at the latest.
  [[nodiscard]] virtual std::optional<ReceivedFrame> receive() = 0;
  /// The descriptor to poll for reading, the same for the life of the bus; -1 while there is nothing to poll.
  [[nodiscard]] virtual int descriptor() const = 0;
  /// When the bus is tried again; nothing while its interface works.
  [[nodiscard]] virtual std::optional<MonotonicTime> retry_at() const = 0;
  [[nodiscard]] virtual const BusHealth& health() const = 0;
};

/// Waits for the next frame until `deadline`, whatever befalls the bus meanwhile.
[[nodiscard]] std::optional<ReceivedFrame> receive_until(CanBus& bus, MonotonicTime deadline);

}  // namespace cairn
