// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/se3.h"
#include "tests/bench/truth.h"

/// How often a relocalizer is right, over queries from places that are mapped and from others.
namespace cairn {

/// Whether a view overlaps one of the mapped ones: its camera stands within `distance` of that and looks
/// within 20 degrees of where it looks. Poses: truth_from_camera, `distance` in the truth's unit.
[[nodiscard]] bool overlaps_a_view(const SE3& view, std::span<const SE3> mapped, double distance);

/// What was said to one query.
struct Judged {
  bool in_view = false;   ///< it overlaps a mapped view, or may well: there is no truth
  bool answered = false;  ///< a place was named
  bool right_map = false;
  std::optional<Offset> off = {};  ///< where there is truth and the map is right
  double depth = 0;                ///< [of the truth] mean distance of what is seen, to judge `off` by
  double tolerance = 0.1;          ///< of the depth, within which a pose is right
};

struct Recall {
  size_t in_view = 0;        ///< queries about views that overlap a mapped one,
  size_t right = 0;          ///< answered with the right map and pose
  size_t elsewhere = 0;      ///< the other queries,
  size_t answered_else = 0;  ///< answered at all
  size_t wrong_map = 0;      ///< of all: another map was named
  size_t wrong_pose = 0;     ///< of all: the right map, but a wrong pose
  std::vector<double> off;   ///< of depth, of all poses in the right map

  void add(const Judged& judged);
  void add(const Recall& other);
  [[nodiscard]] double share() const {
    return in_view == 0 ? 0 : static_cast<double>(right) / static_cast<double>(in_view);
  }
};

/// A pose is right within the tolerance and 5 degrees; one that cannot be judged counts as right.
[[nodiscard]] bool is_right_pose(const Judged& judged);

}  // namespace cairn
