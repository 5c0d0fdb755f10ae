// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "common/base/time.h"
#include "hw/can/can_bus.h"

namespace cairn {

/// Times between tries of what fails: the first one, doubled with each failure up to the longest. A failure
/// before the next try is due changes nothing.
class Backoff {
 public:
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds longest)
      : first_(first), longest_(longest), next_(first) {}

  void failed(MonotonicTime now);
  void succeeded();
  /// When the next try is due; nothing where the last one succeeded.
  [[nodiscard]] std::optional<MonotonicTime> retry_at() const { return retry_at_; }
  [[nodiscard]] bool due(MonotonicTime now) const { return !retry_at_ || now >= *retry_at_; }

 private:
  std::chrono::milliseconds first_;
  std::chrono::milliseconds longest_;
  std::chrono::milliseconds next_;
  std::optional<MonotonicTime> retry_at_;
};

/// Keeps the state of a bus, from what the socket meets: the condition, the counters, and when to try what
/// again. Pure.
class LinkMonitor {
 public:
  void sent();
  void withheld() { ++health_.withheld; }
  void received(MonotonicTime now);
  /// The kernel's count of frames that found the socket's queue full; it wraps at 2^32.
  void lost_so_far(uint32_t count);
  void noticed(const BusErrors& errors, MonotonicTime now);
  /// write() failed with that errno; the frame is lost.
  void send_failed(int error, MonotonicTime now);
  /// The socket or its interface failed with that errno.
  void link_failed(int error, MonotonicTime now);
  /// The interface is there, up, and the socket bound to it.
  void link_works();

  /// Whether a routine frame may be tried. Not while bus-off: the kernel would keep it until the controller
  /// is back. That it is back shows in an error frame, or in any frame that is received.
  [[nodiscard]] bool may_send(MonotonicTime now) const;
  /// When the interface is to be looked at again; nothing while it works.
  [[nodiscard]] std::optional<MonotonicTime> link_retry_at() const { return link_backoff_.retry_at(); }
  [[nodiscard]] const BusHealth& health() const { return health_; }

 private:
  enum class Controller : uint8_t { kActive, kPassive, kBusOff };

  void note_link_error(int error);
  void update();

  BusHealth health_;
  BusCondition link_ = BusCondition::kUp;  ///< kUp, kInterfaceDown, kInterfaceGone or kFault
  int link_error_ = 0;
  Controller controller_ = Controller::kActive;
  bool queue_full_ = false;
  uint32_t lost_count_ = 0;
  MonotonicTime last_error_frame_;
  // A drive's watchdog is 100 ms: the interface is looked at often enough to be back well within a second.
  Backoff link_backoff_{std::chrono::milliseconds(10), std::chrono::milliseconds(200)};
  // Ten frames, the usual transmit queue, take 2.5 ms at 500 kbit/s.
  Backoff queue_backoff_{std::chrono::milliseconds(1), std::chrono::milliseconds(20)};
};

}  // namespace cairn
