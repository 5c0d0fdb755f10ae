// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

#include "hw/app/rig_options.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// Simulated devices on a bus until one of the signals, which are blocked, comes. Lines of stdin are faults.
/// The exit code.
[[nodiscard]] int run_simulation(const RigOptions& options, const RigConfiguration& configuration,
                                 const sigset_t& signals);

}  // namespace cairn
