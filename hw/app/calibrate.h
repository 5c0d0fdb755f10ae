// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

#include "hw/app/rig_options.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// `cairn-rig calibrate`, as of its exit code. `signals`: blocked, and end it.
[[nodiscard]] int run_calibration(const RigOptions& options, const RigConfiguration& configuration,
                                  const sigset_t& signals);

}  // namespace cairn
