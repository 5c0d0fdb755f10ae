// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

/// How alike the query and the keyframes look at the points where a pose puts them, at pyramid level 3 (8 px
/// of the picture): Pearson's correlation over all points, -1..1, of how much brighter each is than what lies
/// around it. That hears of what is on things, and other light or exposure does not matter to it; grey levels
/// themselves are alike at most places by chance (bright above, dark below), and the light's to change. A
/// witness that is independent of corners and their descriptors: it also hears of the points that no corner
/// was found for. Points that others hide from the query are passed over: there the query shows something
/// else, rightly. A sighting counts as often as it is described. -1 without points.
[[nodiscard]] double alikeness(const PlaceView& view, const Camera& camera, const ProjectedPoints& projected);

}  // namespace cairn
