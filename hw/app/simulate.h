// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>
#include <functional>

#include "common/base/result.h"
#include "hw/app/rig_options.h"
#include "hw/can/can_bus.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// The rig's own program, where it lives in the process of its simulated devices.
struct HostOfDevices {
  std::function<void()> stop = [] {};   ///< emergency stop: SIGUSR1 has come
  std::function<void()> close = [] {};  ///< returns when the drives were let go; called by another thread
};

/// Simulated devices on a bus until one of the signals, which are blocked, comes. Lines of stdin say what
/// befalls devices and what the wearer does. Errors: those of the camera's socket.
[[nodiscard]] Status run_simulation(const RigOptions& options, const RigConfiguration& configuration,
                                    const sigset_t& signals, CanBus& bus, const HostOfDevices& host);

}  // namespace cairn
