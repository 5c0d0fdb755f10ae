// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "client/tracking/frame_result.h"
#include "client/tracking/trails.h"
#include "common/geometry/camera.h"
#include "common/map/snapshot.h"

namespace cairn {

struct TrailPoseOptions {
  /// Trails that became points; and of these that agree, where half of them do not agree on a pose near the
  /// second view.
  int fewest = 20;
};

/// The pose of the present frame in the map that was made from trails, by where these are now; nothing when
/// too few are left or they do not agree.
[[nodiscard]] std::optional<SE3> pose_from_trails(const Camera& camera, const MapSnapshot& map,
                                                  const SeedAnswer& seed,
                                                  std::span<const TrailFollower::Live> trails,
                                                  uint64_t random_seed, const TrailPoseOptions& options);

}  // namespace cairn
