// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/base/result.h"

namespace cairn {

/// The facts that the kernel tells of a CAN interface.
struct InterfaceFacts {
  bool is_can = false;
  bool is_up = false;
  std::string kind;  ///< of the device as `ip link` names it: can, vcan; empty: the kernel does not tell
  // Of a controller; a virtual bus has none.
  std::optional<uint32_t> bit_rate;         ///< [1/s]; 0: not set
  std::optional<uint32_t> restart_ms;       ///< 0: it does not come back by itself from bus-off
  std::optional<uint32_t> state;            ///< of linux/can/netlink.h
  std::optional<uint16_t> transmit_errors;  ///< its counters
  std::optional<uint16_t> receive_errors;
};

/// Errors: kConfiguration for an interface that is not there, kIo.
[[nodiscard]] Result<InterfaceFacts> ask_interface(const std::string& name);

}  // namespace cairn
