// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

/// Five places on three floors about a staircase: reception, kitchenette, landing (little to see), copier and
/// library. All are mapped, then visited in another order. The frame of a place has its origin at the height
/// of a counter, X to the right and Y towards the wall behind.
[[nodiscard]] Scenario make_building(const ScenarioOptions& options);

}  // namespace cairn
