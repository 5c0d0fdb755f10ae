// SPDX-License-Identifier: Apache-2.0
#include "hw/can/can_bus.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <ctime>

namespace cairn {

using namespace std::chrono_literals;

std::string describe(const BusHealth& health, std::string_view interface_name) {
  const std::string name(interface_name);
  switch (health.condition) {
    case BusCondition::kUp:
      return {};
    case BusCondition::kErrorPassive:
      return name + ": the bus has many errors (" + describe(health.last_errors) +
             "); is another node powered, at the same bit rate, and is the cable terminated at both ends?";
    case BusCondition::kQueueFull:
      return name +
             ": the transmit queue is full; is another node there to take the frames, and is the bit "
             "rate high enough for them?";
    case BusCondition::kBusOff:
      return name + ": the controller is bus-off (" + describe(health.last_errors) +
             "); check wiring, termination and bit rate. `sudo ip link set " + name +
             " type can restart` brings it back, restart-ms 100 beside the bit rate lets it come back by "
             "itself";
    case BusCondition::kInterfaceDown:
      return name + ": the interface is down; `sudo ip link set " + name +
             " up type can bitrate 500000 restart-ms 100`, a virtual one without what follows `up`. It is "
             "waited for";
    case BusCondition::kInterfaceGone:
      return name +
             ": there is no such interface any more; is its adapter plugged in? `ip -br link show type "
             "can` lists those that are there. It is waited for";
    case BusCondition::kFault:
      return name + ": the system refuses it: " + std::strerror(health.system_error);
  }
  return {};
}

std::optional<ReceivedFrame> receive_until(CanBus& bus, MonotonicTime deadline) {
  while (true) {
    if (auto frame = bus.receive()) return frame;
    const auto now = std::chrono::steady_clock::now();
    if (now >= deadline) return std::nullopt;
    const auto wait = std::min(deadline, bus.retry_at().value_or(deadline)) - now;
    const auto longest = std::clamp<std::chrono::nanoseconds>(wait, 0ns, 60s);
    const auto seconds = std::chrono::floor<std::chrono::seconds>(longest);
    const timespec time{seconds.count(), (longest - seconds).count()};
    pollfd ready{bus.descriptor(), POLLIN, 0};
    ppoll(&ready, 1, &time, nullptr);  // not poll(): a setpoint is due between two milliseconds
  }
}

}  // namespace cairn
