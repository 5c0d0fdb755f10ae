// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

/// A stand with things on it in the middle of a furnished room: what a wearer walks around. The origin is the
/// point of the stand that is as high as the wearer's shoulder.
[[nodiscard]] Scenario make_shoulder(const ScenarioOptions& options);

}  // namespace cairn
