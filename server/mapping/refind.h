// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "common/geometry/depth_order.h"
#include "server/mapping/map_state.h"

namespace cairn {

/// Finds known points in keyframes that do not measure them yet. A point that is not found where points
/// measured beside it stand clearly in front of it is hidden: that says nothing about it, so it is neither
/// counted nor given up. What stands in front in a keyframe is looked up once, when the first miss there is
/// judged: one of these is for one piece of work, between whose searches nothing moves. One thread.
class Refinder {
 public:
  explicit Refinder(MapState* map) : map_(*map) {}

  /// Looks for one point in one keyframe, if it should be visible there: seen from a direction and distance
  /// not far from those of its source; within 4 px of its projection, sub-pixel (PTAM r114). Adds the
  /// measurement or, unless the point is hidden, gives the pair up; counts either on the point. False when
  /// nothing was counted: the pair is known, given up, out of view or hidden.
  bool refind(KeyframeId keyframe, PointId point);

  /// refind() of every live point of the map in a keyframe; those found stand in front, too. Returns how many
  /// were found.
  int refind_all(KeyframeId keyframe);

 private:
  enum class Sight : uint8_t { kNotExpected, kFound, kMissed };
  Sight search(const MapKeyframe& keyframe, PointId point);
  /// Whether points measured beside it in the keyframe stand clearly in front of the point.
  bool is_hidden(const MapKeyframe& keyframe, const MapPoint& point);
  /// After a miss. Whether the pair was given up.
  bool give_up_unless_hidden(const MapKeyframe& keyframe, PointId point);

  MapState& map_;
  std::vector<std::optional<DepthOrder>> orders_;  ///< by keyframe, of the points measured there
};

}  // namespace cairn
