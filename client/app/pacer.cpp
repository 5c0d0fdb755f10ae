// SPDX-License-Identifier: Apache-2.0
#include "client/app/pacer.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;

/// Stamps farther apart are a cut in the recording, not a pause that anyone wants to sit through.
constexpr std::chrono::seconds kLongestStep(5);
/// How long a request to stop may go unheard while waiting for a frame.
constexpr milliseconds kStopPoll(100);

}  // namespace

Pacer::Pacer(FrameSource& source, Pace pace, PaceClock& clock, std::function<bool()> stop_requested)
    : source_(source), pace_(pace), clock_(clock), stop_requested_(std::move(stop_requested)) {}

FrameEvent Pacer::next() {
  if (stop_requested_()) return EndOfFrames{};
  Item item = take_item();
  if (!item) return UndecodableFrame{item.error().message};
  if (!*item) return EndOfFrames{};
  Frame frame = std::move(**item);
  if (pace_ != Pace::kRealtime) return TakenFrame{std::move(frame), clock_.now()};
  return source_.is_live() ? pace_live(std::move(frame)) : pace_recorded(std::move(frame));
}

Pacer::Item Pacer::take_item() {
  if (!lookahead_) return source_.next();
  Item item = std::move(*lookahead_);
  lookahead_.reset();
  return item;
}

FrameEvent Pacer::pace_recorded(Frame frame) {
  last_ = schedule_after(last_, frame.time);
  if (clock_.now() < last_->due) {
    if (!wait_until(last_->due)) return EndOfFrames{};
  } else if (successor_is_due()) {
    return DroppedFrame{frame.time};
  }
  return TakenFrame{std::move(frame), last_->due};
}

/// A live source has dropped by itself what was not taken in time: gaps of the index, reported one by one and
/// before the frame that follows them, with stamps in between.
FrameEvent Pacer::pace_live(Frame frame) {
  if (live_time_ && frame.index > live_index_) {
    const auto missing = static_cast<int64_t>(frame.index - live_index_);
    live_time_ = *live_time_ + (frame.time - *live_time_) / (missing + 1);
    ++live_index_;
    lookahead_ = std::move(frame);
    return DroppedFrame{*live_time_};
  }
  live_time_ = frame.time;
  live_index_ = frame.index + 1;
  return TakenFrame{std::move(frame), clock_.now()};
}

Pacer::Schedule Pacer::schedule_after(const std::optional<Schedule>& last, Timestamp time) const {
  if (!last) return {time, clock_.now(), {}};
  const auto step = time - last->time;
  const bool regular = step >= std::chrono::nanoseconds(0) && step <= kLongestStep;
  const auto used = regular ? step : last->step;
  return {time, last->due + used, used};
}

bool Pacer::successor_is_due() {
  if (!lookahead_) lookahead_ = source_.next();
  if (!lookahead_->has_value() || !(*lookahead_)->has_value()) return false;
  return schedule_after(last_, (**lookahead_)->time).due <= clock_.now();
}

bool Pacer::wait_until(PaceClock::TimePoint time) {
  while (clock_.now() < time) {
    if (stop_requested_()) return false;
    clock_.sleep_until(std::min(time, clock_.now() + kStopPoll));
  }
  return true;
}

}  // namespace cairn
