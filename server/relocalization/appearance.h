// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

/// How alike a query and keyframes look, -1..1 each; -1 without points.
struct Appearance {
  /// Pearson's correlation of how much brighter each point is than what lies around it: that hears of what is
  /// on things, and other light or exposure does not matter to it.
  double local = -1;
  /// Spearman's correlation of the grey levels: which things are brighter than which others, across the
  /// image. Any curve of grey levels keeps that order.
  double order = -1;
  /// Of kImageCells cells of the image, those in which `local` is low, more than chance explains: what is
  /// there is not what the keyframes show. A place like this one is like it in part: the same things stand
  /// there, and others. Cells with fewer than four points say nothing.
  int inconsistent_cells = 0;
};

/// At the points where a pose puts them, at pyramid level 3 (8 px of the image): evidence that is
/// independent of corners and their descriptors, which also hears of the points that no corner was found for.
/// Points that others hide from the query are passed over: there the query shows something else, rightly. A
/// sighting counts as often as it is described.
[[nodiscard]] Appearance compare_appearance(const PlaceView& view, const Camera& camera,
                                            const ProjectedPoints& projected);

}  // namespace cairn
