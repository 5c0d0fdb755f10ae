// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/place_memory.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr float kPlaceBlur = 2.5F;  // PTAM r114

}  // namespace

TinyImage place_image(const FrameImages& frame) {
  return {frame.pyramid.level(kPyramidLevels - 1), kPlaceBlur, frame.still().get()};
}

SE3 turn_between(const TinyImage& then, const TinyImage& now, const Camera& camera) {
  const TinyMotion motion = align_tiny(then, now);
  return std::isfinite(motion.score) ? rotation_from_tiny(motion, camera, now.width()) : SE3();
}

void PlaceMemory::remember(const FrameImages& frame, const MapSnapshot& map, KeyframeId reference,
                           const SE3& camera_from_reference, double mean_depth) {
  for (auto it = views_.rbegin(); it != views_.rend(); ++it) {  // the newest are the likeliest to be near
    const View& view = *it;
    if (view.map != map.map || view.reference != reference) continue;
    const Vector6d step = (camera_from_reference * view.camera_from_reference.inverse()).log();
    if (step.head<3>().norm() < options_.view_distance * mean_depth &&
        step.tail<3>().norm() < options_.view_angle)
      return;
  }
  if (views_.size() == options_.most_views) views_.pop_front();
  views_.push_back({place_image(frame), map.map, reference, camera_from_reference});
}

std::optional<SE3> PlaceMemory::recall(const FrameImages& frame, const Camera& camera, const MapSnapshot& map,
                                       size_t skip) {
  const TinyImage now = place_image(frame);
  ranked_.clear();
  for (size_t i = 0; i < views_.size(); ++i) {
    const View& view = views_[i];
    if (view.map != map.map || map.find(view.reference) == nullptr) continue;
    ranked_.emplace_back(tiny_difference(view.tiny, now), i);
  }
  if (ranked_.empty()) return std::nullopt;
  const auto nth = ranked_.begin() + static_cast<ptrdiff_t>(std::min(skip, ranked_.size() - 1));
  std::nth_element(ranked_.begin(), nth, ranked_.end());
  const View& view = views_[nth->second];
  return turn_between(view.tiny, now, camera) * view.camera_from_reference *
         map.find(view.reference)->camera_from_map;
}

}  // namespace cairn
