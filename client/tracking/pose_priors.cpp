// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/pose_priors.h"

#include "client/tracking/patch_flow.h"
#include "common/geometry/pose.h"

namespace cairn {
namespace {

constexpr size_t kMostFollowed = 150;
constexpr int kFewestFollowed = 12;  // that agree on a pose, as of the coarse stage

}  // namespace

void PosePriors::tracked(const std::vector<VisiblePoint>& points) {
  seen_.clear();
  for (const VisiblePoint& p : points) {
    if (p.found) seen_.push_back({p.id, p.pixel, p.level});
  }
}

void PosePriors::remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose) {
  views_.remember(frame, map, pose, seen_);
}

std::optional<SE3> PosePriors::by_flow(const FrameImages& previous, const FrameImages& now,
                                       const TinyMotion& motion, const MapSnapshot& map) const {
  std::vector<PointObservation> observations;
  const size_t step = seen_.size() / kMostFollowed + 1;
  for (size_t i = 0; i < seen_.size(); i += step) {
    const SeenPoint& p = seen_[i];
    const auto slot = map.find(p.id);
    if (!slot) continue;
    const auto there = follow_patch(previous, now, p.pixel, moved_by(motion, p.pixel, now.pyramid.level(0)));
    if (!there) continue;
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
    observations.push_back({block.position(slot->slot), there->cast<double>(), 1.0});
  }
  PoseRansacOptions ransac;
  ransac.min_inliers = kFewestFollowed;
  ransac.seed = seed_;
  const auto pose = ransac_pose(*camera_, observations, ransac);
  if (!pose) return std::nullopt;
  return pose->camera_from_map;
}

std::optional<SE3> PosePriors::by_corners(const FrameImages& now, const MapSnapshot& map, const SE3& last,
                                          double mean_depth) {
  if (!views_.knows(map)) return std::nullopt;
  if (!described_) described_ = describe_place(now.pyramid, now.all_corners());
  return views_.recognize(*described_, *camera_, map, last, mean_depth, seed_);
}

}  // namespace cairn
