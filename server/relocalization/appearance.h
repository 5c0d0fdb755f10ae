// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/relocalization/match.h"

namespace cairn {

struct AppearanceOptions {
  /// A point that is this many times as deep as its neighbours is behind them, and passed over. Of a plane
  /// turned by 50 degrees the far points of a neighbourhood are, too; the others speak for them.
  float behind = 1.15F;
  /// A cell of the image is inconsistent if its correlation is below `inconsistent` even when it is raised by
  /// `standard_errors` of its standard errors (Fisher's z). The error goes by the number of sightings, which
  /// are not independent, since a point may have four. Both are chosen together, on desks that look alike
  /// (tests/bench/HISTORY.md).
  double inconsistent = 0.35;
  double standard_errors = 2.5;
  int fewest_points = 4;  ///< least number of points in a cell that is judged
};

/// How alike a query and keyframes look. The correlations are -1 to 1, and -1 without points.
struct Appearance {
  /// Pearson's correlation of how much brighter each point is than what lies around it (Brightness::local).
  /// It depends on what is on things, and not on light or exposure.
  double local = -1;
  /// Spearman's correlation of the grey levels: which things are brighter than which others, across the
  /// image. Any curve of grey levels keeps that order.
  double order = -1;
  /// Number of the kImageCells cells of the image in which `local` is lower than chance explains: what is
  /// there is not what the keyframes show. A place like this one is like it in part: the same things stand
  /// there, and others. Cells with too few points say nothing.
  int inconsistent_cells = 0;
};

/// Compares a query with keyframes at the points where a pose puts them, at pyramid level 3 (8 px of the
/// image). This evidence is independent of corners and their descriptors, and takes in the points that no
/// corner was found for. Points that others hide from the query are passed over: there the query shows
/// something else, rightly. A sighting counts as often as it is described.
[[nodiscard]] Appearance compare_appearance(const PlaceView& view, const Camera& camera,
                                            const ProjectedPoints& projected,
                                            const AppearanceOptions& options);

}  // namespace cairn
