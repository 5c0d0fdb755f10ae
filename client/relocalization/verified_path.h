// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "client/relocalization/anchored_pose.h"
#include "common/base/time.h"
#include "common/map/snapshot.h"

namespace cairn {

/// The region in which the centre of a camera can be by now.
struct ReachableRegion {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< if it went on as it did, map frame
  double radius = 0;                                 ///< [map unit] about it

  [[nodiscard]] bool contains(const SE3& camera_from_map) const {
    return (camera_from_map.center() - centre).norm() <= radius;
  }
};

constexpr size_t kMostVerifiedPoses = 96;

struct VerifiedPathOptions {
  double window = 2.0;     ///< [s] of which the acceleration is learnt, as far as the poses kept reach
  double lag = 1.0 / 3;    ///< [s] of which the velocity is
  double shortest = 0.1;   ///< [s] of a path that says something
  double spacing = 0.031;  ///< [s] of what is kept, kMostVerifiedPoses at most
  double sigmas = 6.0;     ///< [sigma] of where the camera is expected, that it may be off
};

/// The poses verified in the last seconds, and by them how well constant velocity foretells this camera: what
/// that missed by is the noise of its acceleration (white; Bar-Shalom, Li and Kirubarajan 2001, section
/// 6.2.2), and with it the place of a camera that is hidden becomes uncertain. Without units: a map's own and
/// how lively this hand is are both in what was measured. Velocity is that of a third of a second, since the
/// step between two frames is mostly noise. Bounded; pure; one thread.
class VerifiedPath {
 public:
  explicit VerifiedPath(const VerifiedPathOptions& options) : options_(options) {}

  /// Adds the pose verified next. Of poses that follow one another faster than `spacing` the newest is kept.
  void add(const AnchoredPose& pose, Timestamp time);
  /// The camera was found again or starts anew: of how it moves, the poses so far say nothing.
  void clear() { count_ = 0; }

  /// The region in which the camera can be at `time`; nothing where the map is another or the path says too
  /// little.
  [[nodiscard]] std::optional<ReachableRegion> reachable(const MapSnapshot& map, Timestamp time) const;
  /// The pose verified last (camera_from_map); nothing where there is none, or none in this map.
  [[nodiscard]] std::optional<SE3> last(const MapSnapshot& map) const;
  /// Whether the pose verified last is of a frame of this time.
  [[nodiscard]] bool ends_at(Timestamp time) const { return count_ > 0 && entry(0).time == time; }

 private:
  struct Entry {
    AnchoredPose pose;
    Timestamp time;
  };
  static constexpr size_t kMost = kMostVerifiedPoses;

  /// `back`: 0 is the latest.
  [[nodiscard]] const Entry& entry(size_t back) const { return entries_[(next_ + kMost - 1 - back) % kMost]; }

  VerifiedPathOptions options_;
  std::array<Entry, kMost> entries_;
  size_t next_ = 0;
  size_t count_ = 0;
};

}  // namespace cairn
