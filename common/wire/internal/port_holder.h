// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace cairn::wire::internal {

/// Whether somebody has a UDP port of this host. Only to say why something could not start.
[[nodiscard]] bool port_is_taken(uint16_t port);

struct PortHolder {
  std::string program;  ///< its name as the system keeps it, at most 15 characters, printable
  int process = 0;
};

/// The process that has a UDP port of this host, as /proc tells; nothing when nobody has it, or a process
/// that we may not look at.
[[nodiscard]] std::optional<PortHolder> find_port_holder(uint16_t port);

}  // namespace cairn::wire::internal
