// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "hw/can/can_bus.h"

namespace cairn {

/// A raw SocketCAN socket on that interface, which gives the frames that a filter passes; without filters,
/// all. The interface must be there; it may be down. Errors: kUsage for a name or number of filters that
/// cannot be, kConfiguration for an interface that is none or a kernel without CAN, kIo for what else the
/// system refuses. The first bus of a machine that is opened may stamp its first frames when they are read:
/// the kernel takes some milliseconds to begin with stamps.
/// "fd:N" is no interface but the end of a bus like make_bus_pair()'s that the process was started with, as
/// descriptor N, and which is the bus's from then on. What came before is dropped. kConfiguration where it is
/// no such socket.
[[nodiscard]] Result<std::unique_ptr<CanBus>> open_can_bus(const std::string& interface_name,
                                                           const std::vector<CanFilter>& filters = {});

/// A bus of two nodes without a CAN controller: sockets of this machine, for simulated devices and tests.
/// When one end is destroyed, the interface of the other is gone. Error kIo.
[[nodiscard]] Result<std::pair<std::unique_ptr<CanBus>, std::unique_ptr<CanBus>>> make_bus_pair(
    const std::vector<CanFilter>& first_filters = {}, const std::vector<CanFilter>& second_filters = {});

}  // namespace cairn
