// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

/// How alike the query and the keyframes look at the points where a pose puts them: Pearson's correlation of
/// the grey levels of pyramid level 3 (8 px of the picture), over all points, -1..1; gain and bias do not
/// matter. A witness that is independent of corners and their descriptors: it also hears of the points that
/// no corner was found for, and of how bright the things between the corners are. -1 without points.
[[nodiscard]] double alikeness(const PlaceView& view, std::span<const ProjectedPoint> points);

}  // namespace cairn
