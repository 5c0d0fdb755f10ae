// SPDX-License-Identifier: Apache-2.0
#include "client/app/frame_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kSettleSlice(100);
constexpr std::chrono::seconds kProposalInterval(3);  ///< longer than the server's: it need refuse none

/// A frame counts as tracked only if its pose comes from points measured in it, whatever the
/// tracker's state.
FrameState frame_state(const FrameResult& result) {
  const bool measured = result.pose_measured && result.map;
  if (measured && result.state == TrackingState::kTracking) return FrameState::kTracking;
  if (measured && result.state == TrackingState::kPoor) return FrameState::kPoor;
  if (result.state == TrackingState::kRotation) return FrameState::kRotation;
  return result.state == TrackingState::kStarting ? FrameState::kStarting : FrameState::kLost;
}

/// The best place that is worth verifying.
std::optional<PlaceCandidate> best_place(const RelocalizationAnswer& answer) {
  if (!has_place(answer.verdict)) return std::nullopt;
  for (const PlaceCandidate& c : answer.candidates) {
    if (c.confirmed || answer.verdict == RelocalizationVerdict::kUnconfirmed) return c;
  }
  return std::nullopt;
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace

FrameLoop::FrameLoop(FrameSource& source, TrackingEngine& tracker, MapLink& link, PaceClock& clock,
                     FrameLoopOptions options, std::vector<FrameObserver*> observers)
    : source_(source),
      tracker_(tracker),
      link_(link),
      clock_(clock),
      options_(std::move(options)),
      observers_(std::move(observers)) {}

Result<bool> FrameLoop::run(const std::function<bool()>& stop_requested) {
  stop_requested_ = stop_requested;
  Pacer pacer(source_, options_.pace, clock_, stop_requested);
  while (true) {
    auto event = pacer.next();
    if (auto* taken = std::get_if<TakenFrame>(&event)) {
      if (auto status = handle(std::move(*taken)); !status) return tl::unexpected(status.error());
    } else if (const auto* dropped = std::get_if<DroppedFrame>(&event)) {
      handle(*dropped);
    } else if (const auto* undecodable = std::get_if<UndecodableFrame>(&event)) {
      handle(*undecodable);
    } else {
      break;
    }
  }
  if (stop_requested()) return false;
  if (source_.is_live()) {
    return fail(ErrorCode::kIo, source_.describe() + ": gives no images any more" +
                                    (last_undecodable_ ? "; " + *last_undecodable_ : ""));
  }
  if (frames_tracked_on_ == 0) {
    return fail(ErrorCode::kDamaged, source_.describe() + ": no frame could be read" +
                                         (last_undecodable_ ? "; the last: " + *last_undecodable_ : ""));
  }
  return true;
}

Status FrameLoop::handle(TakenFrame&& taken) {
  const Frame& frame = taken.frame;
  if (frame.image->width() != options_.width || frame.image->height() != options_.height) {
    const std::string reason = "frame " + std::to_string(frames_seen_) + " is " +
                               size_text(frame.image->width(), frame.image->height()) +
                               ", the calibration is for " + size_text(options_.width, options_.height);
    if (frames_tracked_on_ == 0)
      return fail(ErrorCode::kConfiguration, reason + "; pass the camera's own with --calibration");
    handle(UndecodableFrame{reason});
    return {};
  }
  const auto cpu_start = thread_cpu_time();
  // In this order: the tracker has heard of its seed's map before it sees it.
  const auto snapshot = link_.snapshot();
  deliver_replies();
  take_camera(snapshot);
  add_samples(frame.time);
  tracker_.make_keyframes(wants_keyframes(snapshot, frame.time));
  const FrameResult& result = tracker_.track(frame.image, frame.time, snapshot, &stages_);
  const auto wall = clock_.now() - taken.due;
  settle_verification(result);
  const bool sent = send_proposals(result, frame);
  link_.publish_state(result, frame.time);
  const auto cpu = thread_cpu_time() - cpu_start;

  const auto status = link_.status();
  observe_status(status);
  const auto state = frame_state(result);
  lost_.frame(state, frame.time);
  has_tracked_ = has_tracked_ || result.pose_measured;
  const auto stages = stages_.take();
  const auto labels = result.map ? link_.labels(result.map) : nullptr;
  notify(&FrameObserver::on_frame, FrameReport{frames_seen_, frame, result, state, snapshot, labels, status,
                                               stages, cpu, wall, camera_, options_.rig_text()});
  if (sent && options_.pace == Pace::kLockstep) {
    settle();
    deliver_replies();
    if (map_to_verify_) settle();  // its replica comes
  }
  start_over_if_needed(status, state);
  ++frames_seen_;
  ++frames_tracked_on_;
  return {};
}

void FrameLoop::handle(const DroppedFrame& dropped) {
  notify(&FrameObserver::on_dropped, DroppedReport{frames_seen_, dropped.time});
  ++frames_seen_;
}

void FrameLoop::handle(const UndecodableFrame& undecodable) {
  last_undecodable_ = undecodable.reason;
  notify(&FrameObserver::on_undecodable, UndecodableReport{frames_seen_, undecodable.reason});
  ++frames_seen_;
}

void FrameLoop::add_samples(Timestamp time) {
  if (options_.imu == nullptr) return;
  if (const auto mount = options_.imu->mount(); mount != mount_) {
    mount_ = mount;
    tracker_.use_imu(mount);
  }
  samples_.clear();
  options_.imu->take(time, &samples_);
  tracker_.add_samples(samples_);
  encoders_.clear();
  options_.imu->take_encoders(&encoders_);
  tracker_.add_encoders(encoders_);
}

void FrameLoop::deliver_replies() {
  while (const auto reply = link_.take_seed_reply()) {
    if (reply->answer) {
      tracker_.seed_accepted(*reply->answer);
    } else {
      tracker_.seed_refused(reply->reason);
    }
    notify(&FrameObserver::on_seed_reply, *reply);
  }
  if (const auto answer = link_.take_relocalization_answer()) deliver_place(*answer);
  const auto replies = link_.take_offer_replies();
  for (const OfferReply& reply : replies) {
    if (proposed_ && proposed_->number == reply.number) proposed_->is_decided = true;
    tracker_.keyframe_answered(reply.number, reply.accepted ? std::optional(reply.keyframe) : std::nullopt);
  }
  if (!replies.empty()) notify(&FrameObserver::on_offer_replies, replies);
}

void FrameLoop::take_camera(const MapSnapshotPtr& snapshot) {
  const auto update = link_.take_camera(snapshot);
  if (!update) return;
  camera_ = update->camera;
  tracker_.use_camera(camera_);
  notify(&FrameObserver::on_camera, *update);
}

void FrameLoop::deliver_place(const RelocalizationAnswer& answer) {
  const bool tried = try_place(answer);
  notify(&FrameObserver::on_relocalization_answer, PlaceReport{frames_seen_, asked_, answer, tried});
}

bool FrameLoop::try_place(const RelocalizationAnswer& answer) {
  if (answer.verdict == RelocalizationVerdict::kNotThere) {
    tracker_.place_left_open();
    return false;
  }
  const auto place = best_place(answer);
  const auto hypothesis = place ? std::optional(PoseHypothesis{place->map, place->epoch, place->keyframe,
                                                               place->camera_from_keyframe, place->confirmed})
                                : std::nullopt;
  const PlaceUse use = tracker_.relocalization_answered(hypothesis);
  if (use != PlaceUse::kNotNeeded) lost_.answered(use == PlaceUse::kToVerify);
  if (use != PlaceUse::kToVerify) return false;
  link_.use_map(place->map, place->epoch, place->revision);
  map_to_verify_ = place->map;
  return true;
}

/// Ends a verification when the frame has decided it. The tracker stays in the map in which its pose is
/// measured, whatever was answered meanwhile. A hypothesis that does not hold gives way to the map in which
/// the camera was tracked last: a lost tracker looks there by itself.
void FrameLoop::settle_verification(const FrameResult& result) {
  if (result.pose_measured) verified_ = {result.map, result.epoch, result.revision};
  if (!map_to_verify_) return;
  const bool has_failed = result.map == map_to_verify_ && result.state == TrackingState::kLost &&
                          !result.verifying && verified_.map;
  if (!result.pose_measured && !has_failed) return;
  if (map_to_verify_ != verified_.map) link_.use_map(verified_.map, verified_.epoch, verified_.revision);
  map_to_verify_ = {};
}

void FrameLoop::observe_status(const SessionStatus& status) {
  if (last_status_ && last_status_->link == status.link && last_status_->text == status.text) return;
  notify(&FrameObserver::on_status, status);
  last_status_ = status;
}

/// A proposal for an operator, who looks at it some day, need not come often, and nobody waits for it.
bool FrameLoop::wants_keyframes(const MapSnapshotPtr& snapshot, Timestamp time) const {
  const KeyframeUse use = snapshot ? link_.keyframe_use(snapshot->map) : KeyframeUse::kKeyframe;
  if (use != KeyframeUse::kProposal || !proposed_) return use != KeyframeUse::kNothing;
  return proposed_->is_decided && time - proposed_->time >= kProposalInterval;
}

bool FrameLoop::send_proposals(const FrameResult& result, const Frame& frame) {
  if (result.seed) link_.send_seed(*result.seed);
  // A server that does not know the map would refuse each keyframe of it.
  if (result.keyframe) {
    if (!last_status_ || last_status_->map_known) {
      if (link_.keyframe_use(result.keyframe->map) == KeyframeUse::kProposal)
        proposed_ = Proposed{result.keyframe->number, frame.time, false};
      link_.send_offer(*result.keyframe, frame.image, frame.time);
    } else {
      tracker_.keyframe_answered(result.keyframe->number, std::nullopt);
    }
  }
  if (result.reloc_query) {
    link_.send_query(result.reloc_query, frame.time);
    asked_ = frame.time;
  }
  return result.seed || result.keyframe || result.reloc_query;
}

/// Waits for the server in slices, so that a request to stop is heard while it works.
void FrameLoop::settle() {
  for (auto left = options_.settle_timeout; left > left.zero() && !stop_requested_(); left -= kSettleSlice) {
    if (link_.wait_until_settled(std::min(left, kSettleSlice))) return;
  }
  if (!stop_requested_()) notify(&FrameObserver::on_unsettled, frames_seen_);
}

/// A server that came back without the map will never answer for it: as long as the tracker holds, the
/// replica serves; once lost, another map is the only way on.
std::optional<FrameLoop::StartOver> FrameLoop::reason_to_start_over(const SessionStatus& status,
                                                                    FrameState state) const {
  if (options_.new_map_requested()) return StartOver{"as asked", NewMap::kInAnyCase};
  if (state == FrameState::kStarting && !status.map_known)
    return StartOver{"the server does not know the map that was begun"};
  if (state != FrameState::kLost) return std::nullopt;
  if (!status.map_known) return StartOver{"lost, and the server does not know the map"};
  const auto unmapped_for = lost_.unmapped_for();
  if (!options_.make_maps || unmapped_for <= unmapped_for.zero()) return std::nullopt;
  if (!has_tracked_) return StartOver{"the answer does not hold, and no map is known of this place"};
  if (unmapped_for >= options_.lost_patience) {
    return StartOver{fmt::format("lost for {:.1f} s where no map is known",
                                 std::chrono::duration<double>(unmapped_for).count())};
  }
  return std::nullopt;
}

void FrameLoop::start_over_if_needed(const SessionStatus& status, FrameState state) {
  const auto start = reason_to_start_over(status, state);
  if (!start) return;
  notify(&FrameObserver::on_start_over, StartOverReport{frames_seen_, start->reason, options_.make_maps});
  link_.leave_map();
  tracker_.start_over(start->wish);
  lost_ = {};
  map_to_verify_ = {};
  verified_ = {};
  has_tracked_ = false;
}

template <typename Event, typename Report>
void FrameLoop::notify(Event event, const Report& report) {
  for (auto* observer : observers_) (observer->*event)(report);
}

}  // namespace cairn
