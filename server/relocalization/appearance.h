// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

struct AppearanceOptions {
  /// A point this many times as deep as its neighbours is behind them. Of a plane turned by 50 degrees the
  /// far points of a neighbourhood go, too; the others speak for them.
  float behind = 1.15F;
  /// A cell of the image is inconsistent when the correlation there is below the limit even if it is so many
  /// standard errors higher than found: by the sightings, which are not all by themselves, since a point may
  /// have four. Both chosen together, on desks that look alike (tests/bench/HISTORY.md).
  double inconsistent = 0.35;
  double standard_errors = 2.5;
  int fewest_points = 4;  ///< in a cell that is judged
};

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
  /// there, and others. Cells with too few points say nothing.
  int inconsistent_cells = 0;
};

/// At the points where a pose puts them, at pyramid level 3 (8 px of the image): evidence that is
/// independent of corners and their descriptors, which also hears of the points that no corner was found for.
/// Points that others hide from the query are passed over: there the query shows something else, rightly. A
/// sighting counts as often as it is described.
[[nodiscard]] Appearance compare_appearance(const PlaceView& view, const Camera& camera,
                                            const ProjectedPoints& projected,
                                            const AppearanceOptions& options);

}  // namespace cairn
