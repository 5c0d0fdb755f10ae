// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "common/map/extent.h"
#include "server/mapping/epipolar_search.h"
#include "server/mapping/map_state.h"

/// New points for a keyframe by epipolar search in keyframes that see the same place from elsewhere.
namespace cairn {

/// The other keyframes, at most `count`, that see most of these points [map frame] at a useful parallax, best
/// first. The median parallax of each is at least `min_parallax` [rad].
[[nodiscard]] std::vector<KeyframeId> rank_partners(const MapState& map, const MapKeyframe& keyframe,
                                                    std::span<const Eigen::Vector3d> points,
                                                    double min_parallax, size_t count,
                                                    const TwoViewPointOptions& options);

/// Limits of one call of make_new_points().
struct NewPointsLimits {
  int max_points = 1000;              ///< for this call
  double min_parallax = 0;            ///< [rad] of each point
  size_t first_candidate = 0;         ///< NewPoints::next_candidate of an earlier call
  std::optional<Extent> extent = {};  ///< in which the points must be; nothing: everywhere
};

struct NewPoints {
  std::vector<PointId> made;  ///< in order of creation
  size_t next_candidate = 0;  ///< where the next call goes on
  bool finished = true;       ///< no more candidates at this level, or max_points reached
};

/// Makes points at one pyramid level of a keyframe: candidates away from known measurements, strongest first;
/// each is searched along its epipolar line, accepted if unique, triangulated, and confirmed by reprojection,
/// parallax and, where at least two further keyframes should see it, by a find in one of them (PTAM 2007,
/// 6.2; PTAM r114). `should_yield` is polled about every millisecond.
[[nodiscard]] NewPoints make_new_points(MapState* map, KeyframeId keyframe, int level,
                                        const NewPointsLimits& limits, const TwoViewPointOptions& options,
                                        const std::function<bool()>& should_yield);

}  // namespace cairn
