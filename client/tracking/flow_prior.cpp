// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/flow_prior.h"

#include "common/geometry/pose.h"

namespace cairn {
void FlowPrior::tracked(const std::vector<VisiblePoint>& points) {
  seen_.clear();
  for (const VisiblePoint& p : points) {
    if (p.found) seen_.push_back({p.id, p.pixel, p.level});
  }
}

std::optional<SE3> FlowPrior::pose(const FrameImages& previous, const FrameImages& now,
                                   const TinyMotion& motion, const MapSnapshot& map) const {
  std::vector<PointObservation> observations;
  const size_t step = seen_.size() / options_.most_followed + 1;
  for (size_t i = 0; i < seen_.size(); i += step) {
    const SeenPoint& p = seen_[i];
    const auto slot = map.find(p.id);
    if (!slot) continue;
    const auto there = follow_patch(previous, now, p.pixel, moved_by(motion, p.pixel, now.pyramid.level(0)),
                                    options_.patches);
    if (!there) continue;
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
    observations.push_back({block.position(slot->slot), there->cast<double>(), 1.0});
  }
  PoseRansacOptions ransac;
  ransac.min_inliers = options_.fewest_followed;
  ransac.seed = seed_;
  const auto found = ransac_pose(*camera_, observations, ransac);
  if (!found) return std::nullopt;
  return found->camera_from_map;
}

}  // namespace cairn
