// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/geometry/se3.h"
#include "common/map/ids.h"
#include "common/map/snapshot.h"

namespace cairn {

/// A pose of the camera that survives adjustments of the map.
struct AnchoredPose {
  MapId map;
  KeyframeId reference;
  SE3 camera_from_reference;
};

/// An anchored pose as camera_from_map in a revision of the map. Nothing in another map, or when the keyframe
/// has gone.
[[nodiscard]] inline std::optional<SE3> pose_in(const MapSnapshot& map, const AnchoredPose& pose) {
  const KeyframePose* keyframe = pose.map == map.map ? map.find(pose.reference) : nullptr;
  if (keyframe == nullptr) return std::nullopt;
  return pose.camera_from_reference * keyframe->camera_from_map;
}

}  // namespace cairn
