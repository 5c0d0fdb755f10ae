// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

/// Three rows of five desks. Every desk is a place: the same curved top, screen, keyboard and partition, its
/// own clutter. The frame of a place has its origin on the desk's top, X to the right and Y away from who
/// sits there. Two desks are nearly empty, one of them among the twelve that are mapped.
[[nodiscard]] Scenario make_office(const ScenarioOptions& options);

}  // namespace cairn
