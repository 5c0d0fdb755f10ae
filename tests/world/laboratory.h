// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

/// A room with a bench and, before it, a robot on a trolley: two places, one within the other. The robot is
/// mapped in close-ups, the room from farther away; both are visited, the robot is moved, and both are
/// visited again. The frame of the robot moves with it.
[[nodiscard]] Scenario make_laboratory(const ScenarioOptions& options);

}  // namespace cairn
