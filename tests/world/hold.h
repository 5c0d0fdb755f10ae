// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/scenario.h"

namespace cairn {

// What a camera in a hand goes through, each begun by a few seconds of sideways motion before the desk of
// make_desk(). The desk stands in a room: a bookcase at the right wall, a sideboard at the rear one, and the
// left one blank.

/// The camera turns where it is by 90 degrees, to the bookcase, and back, at up to 90, 60, 120 and 150
/// degrees/s.
[[nodiscard]] Scenario make_pan(const ScenarioOptions& options);
/// The camera is rolled by 60 degrees to either side, at up to 60, 90, 120 and 150 degrees/s.
[[nodiscard]] Scenario make_roll(const ScenarioOptions& options);
/// The camera is turned to the blank wall and back, at up to 30, 90 and 150 degrees/s.
[[nodiscard]] Scenario make_look_away(const ScenarioOptions& options);
/// The motion of make_look_away(), under a line of text that stands still.
[[nodiscard]] Scenario make_watermark(const ScenarioOptions& options);
/// The route of the desk, with smaller turns, in the round image of an endoscope: black around it, with a
/// notch.
[[nodiscard]] Scenario make_border(const ScenarioOptions& options);
/// The route of the desk, whose speed is heeded after eight seconds.
[[nodiscard]] Scenario make_rush(const ScenarioOptions& options);
/// The scenario of an outage: the route leads from the desk along the bookcase to the sideboard and along
/// that, always to what is new.
[[nodiscard]] Scenario make_outage(const ScenarioOptions& options);

}  // namespace cairn
