// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/recovery.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cairn {
void Recovery::start_over(bool insists) {
  state_ = Starting{insists};
  query_.restart();
  path_.clear();
}

void Recovery::begin_map(const AnchoredPose& pose, bool is_tracked, Timestamp time) {
  path_.clear();
  path_.add(pose, time);
  last_sight_ = {};
  verified_time_ = time;
  if (is_tracked) {
    state_ = Tracking{};
  } else {
    state_ = Lost{};
  }
}

void Recovery::begin_verifying(const PoseStart& start, Timestamp time) {
  Verifying verification;
  verification.frames_left = options_.verification_frames;
  verification.needed_quality = start.quality;
  if (const Lost* lost = as<Lost>()) {
    verification.memories_tried = lost->memories_tried;
    verification.lost_at_cut = lost->at_cut;
  }
  verification.is_out_of_reach = !is_reachable(start.camera_from_map);
  if (start.is_own_guess) verification.answer_needed_from = time;
  state_ = verification;
}

bool Recovery::confirm(float quality, const AnchoredPose& pose, Timestamp time, bool is_leap) {
  if (auto* verification = std::get_if<Verifying>(&state_)) {
    verification->quality = quality;
    --verification->frames_left;
    if (needs_more(*verification, time)) return false;
    if (verification->is_out_of_reach) path_.clear();
  }
  state_ = Tracking{quality};
  if (!is_leap) path_.add(pose, time);
  verified_time_ = time;
  query_.verified();
  return true;
}

/// Another frame, or for a while the server's answer.
bool Recovery::needs_more(const Verifying& verification, Timestamp time) const {
  if (verification.frames_left > 0) return true;
  return lacks_answer() && !query_.nobody_answers() &&
         std::abs(seconds_between(time, *verification.answer_needed_from)) < options_.server_patience;
}

void Recovery::turn_away() {
  if (const Tracking* tracking = as<Tracking>()) state_ = Turned{tracking->quality};
}

void Recovery::lose_sight(const FrameImages& before) {
  const Tracking* tracking = as<Tracking>();
  if (as<Turned>() == nullptr && (tracking == nullptr || tracking->failed_frames > 0)) return;
  last_sight_ = path_.ends_at(before_) ? place_image(before) : TinyImage();
}

void Recovery::fail(bool is_cut, Timestamp time) {
  if (const Verifying* verification = as<Verifying>()) {
    state_ = Lost{verification->memories_tried, verification->lost_at_cut};
    query_.reject(time);
  } else if (auto* tracking = std::get_if<Tracking>(&state_)) {
    if (tracking->failed_frames++ == 0) tracking->failed_at_cut = is_cut;
    if (tracking->failed_frames >= options_.lost_after_failed_frames)
      state_ = Lost{0, tracking->failed_at_cut};
  } else if (as<Turned>() != nullptr) {
    state_ = Lost{0, true};
  }
}

void Recovery::remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose,
                        std::span<const SeenPoint> points) {
  places_.remember(frame, map, pose.reference, pose.camera_from_reference, pose.mean_depth);
  views_.remember(frame, map, pose, points);
}

void Recovery::begin_frame(const MapSnapshot& map, double near_depth, Timestamp time) {
  before_ = std::exchange(now_, time);
  described_.reset();
  hypothesis_pose_.reset();
  keyframes_tried_ = 0;
  out_of_reach_.clear();
  shows_within_reach_ = false;
  source_ = Source::kContinued;
  is_compared_ = false;
  region_ = path_.reachable(map, time);
  if (!region_) return;
  region_->radius += options_.same_place * near_depth;
  if (!(region_->radius < near_depth)) region_.reset();  // that is anywhere in the scene
}

std::optional<PoseStart> Recovery::next_start(const FrameImages& frame, const MapSnapshot& map,
                                              const SE3& last, double mean_depth, Timestamp time) {
  is_compared_ = false;
  while (true) {
    const Source source = source_;
    if (source >= Source::kOutOfReach && !out_of_reach_.empty()) return next_out_of_reach();
    if (source == Source::kNone) return std::nullopt;
    const bool is_repeated = source == Source::kKeyframes && ++keyframes_tried_ < options_.rounds.per_frame;
    if (!is_repeated) source_ = static_cast<Source>(static_cast<int>(source) + 1);
    if (!is_worth_trying(source, time)) continue;
    if (source == Source::kRejected && hypothesis_pose_) query_.reject(time);
    const auto start = start_from(source, frame, map, last, mean_depth);
    if (!start) continue;
    if (is_reachable(start->camera_from_map)) return start;
    out_of_reach_.push_back({*start});
  }
}

PoseStart Recovery::next_out_of_reach() {
  const OutOfReach next = out_of_reach_.front();
  out_of_reach_.pop_front();
  is_compared_ = next.is_compared;
  return next.start;
}

/// Turned as there, the camera is looked for within reach, and there again.
void Recovery::compare_within_reach(const PoseStart& found) {
  out_of_reach_.push_front({found, true});
  out_of_reach_.push_front(
      {{within_reach(found.camera_from_map), PoseStart::Reach::kNear, options_.verified_quality, true},
       true});
}

std::optional<PoseStart> Recovery::believe(const PoseStart& start, const FoundPose& found, Timestamp time) {
  PoseStart needed = start;
  needed.camera_from_map = found.camera_from_map;
  const bool is_near = is_reachable(found.camera_from_map);
  if (is_near && region_) {
    shows_within_reach_ |= found.points >= options_.fewest_points && found.quality >= options_.least_quality;
    needed.quality = std::min(needed.quality, options_.hypothesis_quality);
    if (!may_be_elsewhere(time) && !was_lost_at_cut()) needed.is_own_guess = false;
  }
  if (found.points < options_.fewest_points || found.quality < needed.quality) return std::nullopt;
  if (is_near) return needed;
  if (!is_compared_) compare_within_reach(needed);
  if (!is_compared_ || shows_within_reach_) return std::nullopt;
  return needed;
}

/// Desks look alike to who compares with one map only: after a while it takes the word of the server, which
/// compares with all, and asks for more likeness than points can show. Keyframes are looked through when
/// nobody can be asked.
bool Recovery::is_worth_trying(Source source, Timestamp time) const {
  switch (source) {
    case Source::kConfirmed:
    case Source::kHypothesis:
    case Source::kOutOfReach:
    case Source::kRejected:
      return true;
    case Source::kContinued:
    case Source::kTurned:
      return is_lost() && region_;
    case Source::kCorners:
    case Source::kMemory:
    case Source::kVerified:
      return is_lost() && (query_.nobody_answers() || !may_be_elsewhere(time) || (region_));
    case Source::kKeyframes:
    case Source::kNone:
      return is_lost() && query_.nobody_answers();
  }
  return false;
}

std::optional<PoseStart> Recovery::start_from(Source source, const FrameImages& frame, const MapSnapshot& map,
                                              const SE3& last, double mean_depth) {
  using Reach = PoseStart::Reach;
  const auto guess = [this](const std::optional<SE3>& pose, Reach reach) -> std::optional<PoseStart> {
    if (!pose) return std::nullopt;
    return PoseStart{*pose, reach, options_.verified_quality, true};
  };
  switch (source) {
    case Source::kContinued:
      return guess(within_reach(last), Reach::kNear);
    case Source::kTurned:
      if (const auto turned = turned_since(frame, map)) return guess(within_reach(*turned), Reach::kNear);
      return std::nullopt;
    case Source::kConfirmed:
      // What geometry confirms is right to a few pixels: who looks no farther meets fewer look-alikes.
      hypothesis_pose_ = query_.take(frame, *camera_, map);
      if (!hypothesis_pose_ || !query_.took_confirmed()) return std::nullopt;
      return PoseStart{*hypothesis_pose_, Reach::kNear, options_.hypothesis_quality, false};
    case Source::kHypothesis:
      if (!hypothesis_pose_) return std::nullopt;
      return PoseStart{*hypothesis_pose_, Reach::kWide, options_.hypothesis_quality, false};
    case Source::kCorners:
      return guess(by_corners(frame, map, last, mean_depth), Reach::kNear);
    case Source::kMemory:
      return guess(places_.recall(frame, *camera_, map, next_memory()), Reach::kWide);
    case Source::kVerified:
      return guess(path_.last(map), Reach::kWide);
    case Source::kKeyframes:
      return guess(rounds_.next(map), Reach::kQuick);
    case Source::kOutOfReach:
    case Source::kRejected:
    case Source::kNone:
      break;
  }
  return std::nullopt;
}

size_t Recovery::next_memory() {
  auto* lost = std::get_if<Lost>(&state_);
  return lost == nullptr ? 0 : lost->memories_tried++ % options_.memories_tried;
}

SE3 Recovery::within_reach(const SE3& turned) const {
  if (!region_) return turned;
  return {turned.rotation(), -(turned.rotation() * region_->centre)};
}

/// The pose verified last, turned as the small images then and now say: what came between, a hand maybe, has
/// no part in it.
std::optional<SE3> Recovery::turned_since(const FrameImages& frame, const MapSnapshot& map) const {
  const auto last = path_.last(map);
  if (!last || last_sight_.empty()) return std::nullopt;
  return turn_between(last_sight_, place_image(frame), *camera_) * *last;
}

std::optional<SE3> Recovery::by_corners(const FrameImages& frame, const MapSnapshot& map, const SE3& last,
                                        double mean_depth) {
  if (!views_.knows(map)) return std::nullopt;
  if (!described_) described_ = describe_place(frame.pyramid, frame.all_corners());
  return views_.recognize(*described_, *camera_, map, last, mean_depth, options_.seed);
}

bool Recovery::may_be_elsewhere(Timestamp time) const {
  const double since = seconds_between(time, verified_time_);
  return since < 0 || since > options_.still_here || query_.is_elsewhere();
}

std::shared_ptr<const PlaceView> Recovery::ask(const FrameImages& frame, Timestamp time, bool may_enter,
                                               const std::optional<UpDirection>& up) {
  if (!is_asking(may_enter)) return nullptr;
  return query_.ask(frame, time, up);
}

/// Whether a hypothesis would be verified.
bool Recovery::is_looking(bool may_enter) const {
  if (const Starting* starting = as<Starting>()) return may_enter && !starting->insists;
  return is_lost() || as<Turned>() != nullptr;
}

/// Whether it is worth asking the server where the camera is: the answer takes its time, and one frame that
/// fails may be the first of many.
bool Recovery::is_asking(bool may_enter) const {
  const Tracking* tracking = as<Tracking>();
  return is_looking(may_enter) || (tracking != nullptr && tracking->failed_frames > 0) || lacks_answer();
}

bool Recovery::lacks_answer() const {
  const Verifying* verification = as<Verifying>();
  return verification != nullptr && verification->answer_needed_from &&
         !query_.is_answered_since(*verification->answer_needed_from);
}

/// The map in use is left for another only when it is not in sight, or when the image changed as no hand
/// can move.
bool Recovery::wants(const PoseHypothesis& place, std::optional<MapId> map, bool may_enter) const {
  if (is_looking(may_enter)) return true;
  const Tracking* tracking = as<Tracking>();
  const bool failed_at_cut = tracking != nullptr && tracking->failed_at_cut;
  return is_asking(may_enter) && (failed_at_cut || place.map == map);
}

/// Whether the server has confirmed the camera in another map than the one in which the tracker verifies its
/// own guess.
bool Recovery::is_contradicted_by(const PoseHypothesis& place, std::optional<MapId> map) const {
  const Verifying* verification = as<Verifying>();
  return verification != nullptr && verification->answer_needed_from &&
         query_.is_answered_since(*verification->answer_needed_from) && place.confirmed && place.map != map;
}

PlaceUse Recovery::answered(const std::optional<PoseHypothesis>& hypothesis, std::optional<MapId> map,
                            bool may_enter) {
  if (!query_.answered(hypothesis)) return PlaceUse::kNotKnown;
  if (is_contradicted_by(*hypothesis, map)) {
    state_ = Lost{as<Verifying>()->memories_tried, true};
    query_.contradict();
  }
  if (wants(*hypothesis, map, may_enter)) return PlaceUse::kToVerify;
  query_.drop_hypothesis();
  return PlaceUse::kNotNeeded;
}

}  // namespace cairn
