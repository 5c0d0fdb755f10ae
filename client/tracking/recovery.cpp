// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/recovery.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cairn {
namespace {

constexpr float kPlaceBlur = 2.5F;                     // ptam.md 11
constexpr size_t kMostViews = 400;                     // 5 kB each
constexpr double kViewDistance = 0.05;                 // of the mean depth
constexpr double kViewAngle = 0.07;                    // [rad]
constexpr double kQuestionInterval = 1.0 / 15 - 1e-3;  // [s]
constexpr double kAnswerPatience = 0.5;                // [s]

TinyImage place_image(const FrameImages& frame) {
  return {frame.pyramid.level(kPyramidLevels - 1), kPlaceBlur};
}

}  // namespace

void PlaceMemory::remember(const FrameImages& frame, KeyframeId reference, const SE3& camera_from_reference,
                           double mean_depth) {
  for (auto view = views_.rbegin(); view != views_.rend(); ++view) {
    if (view->reference != reference) continue;
    const Vector6d step = (camera_from_reference * view->camera_from_reference.inverse()).log();
    if (step.head<3>().norm() < kViewDistance * mean_depth && step.tail<3>().norm() < kViewAngle) return;
  }
  if (views_.size() == kMostViews) views_.erase(views_.begin());
  views_.push_back({place_image(frame), reference, camera_from_reference});
}

std::optional<PlaceMemory::Candidate> PlaceMemory::recall(const FrameImages& frame, const Camera& camera,
                                                          size_t skip) const {
  if (views_.empty()) return std::nullopt;
  const TinyImage now = place_image(frame);
  std::vector<std::pair<float, size_t>> ranked;
  ranked.reserve(views_.size());
  for (size_t i = 0; i < views_.size(); ++i) ranked.emplace_back(tiny_difference(views_[i].tiny, now), i);
  const auto nth = ranked.begin() + static_cast<ptrdiff_t>(std::min(skip, ranked.size() - 1));
  std::nth_element(ranked.begin(), nth, ranked.end());
  const View& view = views_[nth->second];
  const SE3 turn = rotation_from_tiny(align_tiny(view.tiny, now), camera, now.width());
  return Candidate{view.reference, turn * view.camera_from_reference};
}

std::shared_ptr<const PlaceView> PlaceQuestion::ask(const FrameImages& frame, Timestamp time) {
  if (asked_) {
    const double since = seconds_between(time, *asked_);
    // Recordings may jump back: a question from the future is an old one.
    if (since >= 0 && since < (under_way_ ? kAnswerPatience : kQuestionInterval)) return nullptr;
  }
  asked_ = time;
  under_way_ = true;
  tiny_ = place_image(frame);
  return std::make_shared<const PlaceView>(describe_place(frame.pyramid, frame.corners));
}

void PlaceQuestion::answered(const std::optional<PoseSuggestion>& suggestion) {
  under_way_ = false;
  suggestion_ = suggestion;
}

std::optional<PoseSuggestion> PlaceQuestion::take(const FrameImages& frame, const Camera& camera) {
  if (!suggestion_) return std::nullopt;
  std::optional<PoseSuggestion> taken;
  taken.swap(suggestion_);
  if (tiny_.empty()) return taken;
  const TinyImage now = place_image(frame);
  const TinyMotion motion = align_tiny(tiny_, now);
  if (std::isfinite(motion.score)) {
    taken->camera_from_reference =
        rotation_from_tiny(motion, camera, now.width()) * taken->camera_from_reference;
  }
  return taken;
}

}  // namespace cairn
