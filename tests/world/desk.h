// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "tests/world/scenario.h"

namespace cairn {

/// A desk 1.6 m wide and 0.8 m deep, top at Z = 0, origin at its middle, X to the right and Y away from the
/// viewer.
[[nodiscard]] Scenario make_desk(const ScenarioOptions& options);
/// The same desk and route after things on its left side have been moved.
[[nodiscard]] Scenario make_desk_moved(const ScenarioOptions& options);

}  // namespace cairn
