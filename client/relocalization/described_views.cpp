// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/described_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace cairn {
namespace {

double apart(const SE3& a_from_map, const SE3& b_from_map, double mean_depth) {
  const double turn = so3_log((a_from_map * b_from_map.inverse()).rotation()).norm();
  return turn + (a_from_map.center() - b_from_map.center()).norm() / mean_depth;
}

}  // namespace

bool DescribedViews::is_near_another(const MapSnapshot& map, const ViewPose& pose) const {
  const KeyframePose* reference = map.find(pose.reference);
  if (reference == nullptr) return false;
  const SE3 camera_from_map = pose.camera_from_reference * reference->camera_from_map;
  const Eigen::Vector3d center = camera_from_map.center();
  // The newest are the likeliest to be near: of most frames the first one looked at is.
  return std::any_of(views_.rbegin(), views_.rend(), [&](const View& view) {
    const KeyframePose* keyframe = view.map == map.map ? map.find(view.pose.reference) : nullptr;
    if (keyframe == nullptr) return false;
    const SE3 other = view.pose.camera_from_reference * keyframe->camera_from_map;
    return (other.center() - center).norm() < options_.view_distance * pose.mean_depth &&
           other.rotation().angularDistance(camera_from_map.rotation()) < options_.view_angle;
  });
}

void DescribedViews::remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose,
                              std::span<const SeenPoint> points) {
  if (is_near_another(map, pose)) return;
  if (views_.size() == options_.most_views) views_.pop_front();
  View& view = views_.emplace_back();
  view.map = map.map;
  view.pose = pose;
  const size_t step = points.size() / options_.most_points + 1;
  for (int level = 0; level < kPyramidLevels; ++level) {
    bool is_smoothed = false;
    for (size_t i = 0; i < points.size(); i += step) {
      const SeenPoint& p = points[i];
      if (p.level != level) continue;
      if (!std::exchange(is_smoothed, true)) smooth_for_descriptors(frame.pyramid.level(level), &smoothed_);
      const Corner corner{static_cast<int16_t>(std::lround(to_level(p.pixel.x(), level))),
                          static_cast<int16_t>(std::lround(to_level(p.pixel.y(), level)))};
      Descriptor descriptor;
      if (!describe(smoothed_, corner, &descriptor)) continue;
      view.points.push_back(p.id);
      view.descriptors.push_back(descriptor);
    }
  }
}

bool DescribedViews::knows(const MapSnapshot& map) const {
  return std::any_of(views_.begin(), views_.end(), [&](const View& view) { return view.map == map.map; });
}

std::vector<const DescribedViews::View*> DescribedViews::nearest(const MapSnapshot& map, const SE3& last,
                                                                 double mean_depth) const {
  std::vector<std::pair<double, size_t>> ranked;
  for (size_t i = 0; i < views_.size(); ++i) {
    const ViewPose& pose = views_[i].pose;
    const KeyframePose* keyframe = views_[i].map == map.map ? map.find(pose.reference) : nullptr;
    if (keyframe == nullptr) continue;
    ranked.emplace_back(apart(pose.camera_from_reference * keyframe->camera_from_map, last, mean_depth), i);
  }
  std::sort(ranked.begin(), ranked.end());
  ranked.resize(std::min<size_t>(ranked.size(), options_.views_tried));
  std::vector<const View*> out;
  out.reserve(ranked.size());
  for (const auto& [distance, i] : ranked) out.push_back(&views_[i]);
  return out;
}

/// Matches each corner with the point that looks most like it in any of the views.
std::vector<PointObservation> DescribedViews::match(const PlaceView& frame, const MapSnapshot& map,
                                                    std::span<const View* const> views) const {
  std::vector<Descriptor> corners;
  corners.reserve(frame.corners.size());
  for (const PlaceCorner& c : frame.corners) corners.push_back(c.descriptor);
  struct Match {
    int distance = std::numeric_limits<int>::max();
    PointId point;
  };
  std::vector<Match> best(corners.size());
  for (const View* view : views) {
    for (size_t i = 0; i < view->points.size(); ++i) {
      const NearestDescriptor near = find_nearest(view->descriptors[i], corners);
      const bool is_like =
          near.index >= 0 && near.distance <= options_.most_distance &&
          static_cast<float>(near.distance) <= options_.most_ratio * static_cast<float>(near.second_distance);
      if (!is_like) continue;
      Match& match = best[static_cast<size_t>(near.index)];
      if (near.distance < match.distance) match = {near.distance, view->points[i]};
    }
  }
  std::vector<PointObservation> observations;
  for (size_t i = 0; i < best.size(); ++i) {
    const auto slot = best[i].distance <= options_.most_distance ? map.find(best[i].point) : std::nullopt;
    if (!slot) continue;
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
    if ((block.live >> slot->slot & 1) == 0) continue;
    observations.push_back({block.position(slot->slot), frame.corners[i].pixel.cast<double>(),
                            static_cast<double>(1 << frame.corners[i].level)});
  }
  return observations;
}

std::optional<SE3> DescribedViews::recognize(const PlaceView& frame, const Camera& camera,
                                             const MapSnapshot& map, const SE3& last, double mean_depth,
                                             uint64_t seed) const {
  const std::vector<const View*> views = nearest(map, last, mean_depth);
  PoseRansacOptions options;
  options.min_inliers = options_.fewest_inliers;
  options.seed = seed;
  const auto pose = ransac_pose(camera, match(frame, map, views), options);
  if (!pose) return std::nullopt;
  return pose->camera_from_map;
}

}  // namespace cairn
