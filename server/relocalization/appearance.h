// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

/// How alike the query and the keyframes look at the points where a pose puts them, at pyramid level 3 (8 px
/// of the picture): the mean of two of Pearson's correlations over all points, -1..1. That of the grey levels
/// hears of how bright things are; that of how much brighter each point is than what lies around it hears of
/// what is on them, and other light, which changes slowly across the picture, does not matter to it. A
/// witness that is independent of corners and their descriptors: it also hears of the points that no corner
/// was found for. Points that others hide from the query are passed over: there the query shows something
/// else, rightly. A sighting counts as often as it is described. -1 without points.
[[nodiscard]] double alikeness(const PlaceView& view, const Camera& camera, const ProjectedPoints& projected);

}  // namespace cairn
