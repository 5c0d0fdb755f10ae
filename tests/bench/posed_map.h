// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/io/trajectory.h"
#include "server/mapping/map_record.h"
#include "tests/bench/mapping_loop.h"

namespace cairn {

/// An image whose camera stood at a known place.
struct PosedStill {
  Timestamp time;
  GrayImagePtr image;
  SE3 camera_from_world;
};

struct PosedMap {
  IndexedMapPtr map;
  std::vector<StampedPose> poses;  ///< map_from_camera, after adjustment
  MapRecord record;                ///< of the map
};

/// A map of stills that are too far apart for a tracker: corners that look alike in two of them and agree
/// with their poses become the first points; from there on it is a map maker's map like any other, restored
/// with every still still wanting points: epipolar search, finding again, adjustment. kDegenerate when fewer
/// than two stills have points in common.
[[nodiscard]] Result<PosedMap> map_posed_stills(const CameraPtr& camera,
                                                const std::vector<PosedStill>& stills, MapId map,
                                                uint64_t seed);

}  // namespace cairn
