// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

/// A model of a temple, 0.4 m long, before black: its columns and what is over them are equal, and share
/// their pictures; the rest is plain, but for a door and an altar in front. The camera, of a long focal
/// length, goes round it at 1.5 m once in 9.6 s.
[[nodiscard]] Scenario make_columns(const ScenarioOptions& options);

}  // namespace cairn
