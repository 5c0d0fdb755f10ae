// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

constexpr double kBay = 2.4;  ///< m, the length of one

/// A footbridge of 30 equal bays at night, with lit windows far off. The wearer sways aside at its beginning
/// and then walks along it, looking ahead, at 1.4 m/s.
[[nodiscard]] Scenario make_bays(const ScenarioOptions& options);

}  // namespace cairn
