// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/trail_pose.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "common/geometry/pose.h"

namespace cairn {

std::optional<SE3> pose_from_trails(const Camera& camera, const MapSnapshot& map, const SeedAnswer& seed,
                                    std::span<const TrailFollower::Live> trails, uint64_t random_seed,
                                    const TrailPoseOptions& options) {
  const KeyframePose* second = map.find(seed.second_keyframe);
  if (second == nullptr) return std::nullopt;
  std::vector<std::pair<TrailId, PointId>> points = seed.points;
  std::sort(points.begin(), points.end());
  std::vector<PointObservation> observations;
  for (const TrailFollower::Live& trail : trails) {
    const auto match = std::lower_bound(points.begin(), points.end(), std::pair(trail.id, PointId{}));
    if (match == points.end() || match->first != trail.id) continue;
    const auto slot = map.find(match->second);
    if (!slot) continue;
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
    observations.push_back({block.position(slot->slot), trail.now.cast<double>(), 1.0});
  }
  if (observations.size() < static_cast<size_t>(options.fewest)) return std::nullopt;
  const auto near = optimize_pose(camera, second->camera_from_map, observations);
  if (near && near->inliers >= static_cast<int>(observations.size()) / 2) return near->camera_from_map;
  PoseRansacOptions ransac;
  ransac.min_inliers = options.fewest;
  ransac.seed = random_seed;
  const auto anywhere = ransac_pose(camera, observations, ransac);
  if (!anywhere) return std::nullopt;
  return anywhere->camera_from_map;
}

}  // namespace cairn
