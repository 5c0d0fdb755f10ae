// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hw/app/rig_options.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// Examines interface and bus, a line for each check on stdout. The exit code: 1 where one failed.
[[nodiscard]] int run_doctor(const RigOptions& options, const RigConfiguration& configuration);

}  // namespace cairn
