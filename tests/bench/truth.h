// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "common/geometry/alignment.h"
#include "common/io/trajectory.h"

/// Exact poses of a recording, and how far a pose in a map is from them.
namespace cairn {

/// Exact poses by time.
class Truth {
 public:
  Truth() = default;
  explicit Truth(const Trajectory& trajectory);
  /// truth_from_camera of the frame; null: none near enough.
  [[nodiscard]] const SE3* at(Timestamp time) const;
  /// truth_from_camera at a time, interpolated between two poses that are not far apart; nothing: none are.
  [[nodiscard]] std::optional<SE3> interpolated(Timestamp time) const;
  [[nodiscard]] bool empty() const { return poses_.empty(); }

 private:
  std::map<Timestamp, SE3> poses_;
};

/// The similarity from a map to its truth, by poses of its making (map_from_camera).
[[nodiscard]] Result<Similarity3> align(const std::vector<StampedPose>& poses, const Truth& truth);

/// How far a pose is from the truth.
struct Offset {
  double metres = 0;
  double degrees = 0;
  [[nodiscard]] bool is_right(double tolerance) const { return metres <= tolerance && degrees <= 5; }
};
/// `exact`: truth_from_camera.
[[nodiscard]] Offset compare(const Similarity3& truth_from_map, const SE3& camera_from_map, const SE3& exact);

}  // namespace cairn
