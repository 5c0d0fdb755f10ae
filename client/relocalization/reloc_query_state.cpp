// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/reloc_query_state.h"

#include <utility>

#include "client/relocalization/place_memory.h"

namespace cairn {
std::shared_ptr<const PlaceView> RelocQueryState::ask(const FrameImages& frame, Timestamp time,
                                                      const std::optional<UpDirection>& up) {
  if (asked_) {
    const double since = seconds_between(time, *asked_);
    // Recordings may jump back: a query from the future is an old one.
    if (since >= 0 && since < (under_way_ ? options_.patience : options_.interval)) return nullptr;
    if (since >= 0 && under_way_) nobody_answers_ = true;
  }
  asked_ = time;
  under_way_ = true;
  tiny_ = place_image(frame);
  auto view = std::make_shared<PlaceView>(describe_place(frame.pyramid, frame.all_corners()));
  view->up = up;
  shows_much_ = view->corners.size() >= options_.much_to_see;
  return view;
}

bool RelocQueryState::answered(const std::optional<PoseHypothesis>& hypothesis) {
  left_open();
  answered_ = asked_;
  const bool is_news = hypothesis && !(asked_ && rejected_.is_rejected(*hypothesis, *asked_));
  hypothesis_ = is_news ? hypothesis : std::nullopt;
  not_known_ = is_news ? std::nullopt : asked_;
  is_elsewhere_ |= !hypothesis && shows_much_;
  return is_news;
}

void RelocQueryState::restart() {
  RejectedHypotheses rejected = std::move(rejected_);
  *this = RelocQueryState(options_);
  rejected_ = std::move(rejected);
}

void RelocQueryState::reject(Timestamp time) {
  if (taken_) rejected_.reject(*taken_, time);
  taken_.reset();
}

bool RelocQueryState::has_hypothesis_in(const MapSnapshot& map) const {
  return hypothesis_ && hypothesis_->map == map.map && hypothesis_->epoch == map.epoch;
}

std::optional<SE3> RelocQueryState::take(const FrameImages& frame, const Camera& camera,
                                         const MapSnapshot& map) {
  if (!has_hypothesis_in(map)) return std::nullopt;
  const PoseHypothesis taken = *hypothesis_;
  taken_ = taken;
  hypothesis_.reset();
  const KeyframePose* keyframe = map.find(taken.reference);
  if (keyframe == nullptr) return std::nullopt;
  const SE3 turn = tiny_.empty() ? SE3() : turn_between(tiny_, place_image(frame), camera);
  return turn * taken.camera_from_reference * keyframe->camera_from_map;
}

bool RelocQueryState::is_not_known(Timestamp begin, Timestamp time) const {
  return not_known_ && *not_known_ >= begin && *not_known_ <= time &&
         seconds_between(time, *not_known_) <= options_.fresh;
}

}  // namespace cairn
