// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/tracking/plane_scene.h"
#include "client/tracking/tracker.h"

namespace cairn::test {

/// The answer by which a tracker takes a map made without a map maker (PlaneScene, RoundRoom) for its own:
/// without trails it looks from the map's one keyframe.
[[nodiscard]] inline SeedAnswer answer_with(const MapSnapshot& map) {
  SeedAnswer answer;
  answer.map = map.map;
  answer.second_keyframe = KeyframeId{1};
  return answer;
}

/// A tracker that makes no maps, and the map of one view of a plane that it is to be tracked in.
struct TrackerOnPlane {
  TrackerOnPlane(const CameraPtr& camera, const SE3& view)
      : scene(3, camera), map(scene.make_map(view)), tracker(camera, without_maps()) {
    tracker.seed_accepted(answer_with(*map));
  }

  [[nodiscard]] static TrackerOptions without_maps() {
    TrackerOptions options;
    options.make_maps = false;
    return options;
  }

  const PlaneScene scene;
  const MapSnapshotPtr map;
  Tracker tracker;
};

}  // namespace cairn::test
