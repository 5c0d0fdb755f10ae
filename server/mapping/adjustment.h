// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "common/bundle/bundle.h"
#include "server/mapping/map_maker.h"
#include "server/mapping/map_state.h"

/// Which part of a map is adjusted, and what becomes of the result.
namespace cairn {

/// A bundle problem cut out of a map, and where its numbers belong.
struct MapProblem {
  BundleProblem bundle;
  std::vector<KeyframeId> keyframes;  ///< of bundle.poses, ascending
  std::vector<PointId> points;        ///< of bundle.points, ascending
  std::vector<CutCamera> cameras;     ///< of bundle.free_cameras
};

/// The problem of a local adjustment: the newest keyframe and its `neighbours` closest by shared points
/// (never the first keyframe) move with all their points; every other observer is fixed (PTAM r114).
[[nodiscard]] MapProblem local_problem(const MapState& map, KeyframeId newest, int neighbours);
/// The problem of a global adjustment: all but the first keyframe move, and so do cameras that are being
/// calibrated, once they have three keyframes: two views hardly tell a focal length. At most four of these
/// cameras move and at most two are judged, those with most new keyframes. These numbers are of `options`.
[[nodiscard]] MapProblem global_problem(const MapState& map, const SelfCalibrationOptions& options);

/// Writes a solved problem into a map that may have changed since the problem was cut: removed things stay
/// removed, keyframes not in the problem keep their pose relative to their reference keyframe, points not in
/// it theirs relative to their source. Drops measurements that the robust cost calls outliers, refreshes
/// depths. Unless two fixed keyframes hold the map's frame and unit, the map as a whole stays where it was,
/// by the similarity that brings the keyframes, and what they look at, back nearest to before.
void write_back(const MapProblem& solved, double squared_cutoff, const SelfCalibrationOptions& options,
                MapState* map);

/// Runs solve_bundle(), or solves the same problem by Ceres.
BundleReport minimize(BundleProblem* problem, const BundleOptions& options, Adjuster adjuster);
/// Minimizes a local problem and writes it back, with the map as a whole where it was, as by write_back().
/// The map is untouched unless the report says usable.
BundleReport adjust_locally(MapState* map, KeyframeId newest, const MapMakerOptions& options,
                            const std::function<bool()>& should_stop);
/// Adjusts the whole map and writes it back, to convergence: for the start, when the map is small.
BundleReport adjust_whole(MapState* map, const MapMakerOptions& options);

/// Options with which a global adjustment is solved, wherever it runs.
[[nodiscard]] BundleOptions global_options(const AdjustmentOptions& options,
                                           const std::function<bool()>& should_stop);

class GlobalAdjustment {
 public:
  Adjuster adjuster = Adjuster::kOwn;
  AdjustmentOptions options;
  MapProblem problem;
  BundleReport report;
  size_t keyframes_at_cut = 0;  ///< of the map, when the problem was cut
};

}  // namespace cairn
