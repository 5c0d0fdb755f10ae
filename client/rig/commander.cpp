// SPDX-License-Identifier: Apache-2.0
#include "client/rig/commander.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cairn {
namespace {

using wire::RigAxisCondition;
using wire::RigMode;

constexpr int kPercent = 100;

RigMode mode_of(RigAim aim) {
  constexpr std::array modes = {RigMode::kNeutral, RigMode::kFollow, RigMode::kLock, RigMode::kFixate,
                                RigMode::kSearch};
  return modes.at(static_cast<size_t>(aim));
}

bool moves(RigMode mode) {
  return mode != RigMode::kIdle && mode != RigMode::kClear && mode != RigMode::kStop &&
         mode != RigMode::kClearStop;
}

}  // namespace

std::string_view to_string(RigAim aim) {
  return wire::name_of(mode_of(aim));
}

RigCommander::RigCommander(std::string rig, std::string name, SessionId session, RigAim aim,
                           wire::RigSearchPattern pattern, const CommanderOptions& options)
    : options_(options), rig_(std::move(rig)), name_(std::move(name)), aim_(aim), pattern_(pattern) {
  order_.order.session = session;
}

void RigCommander::want(RigAim aim) {
  aim_ = aim;
  ++wants_;
  rests_ = false;
  looking_ = Looking::kNot;
  if (!has_found_enough()) found_ = Nothing();
  sighting_.reset();
  ordered_ = {};
  order_.mode = RigMode::kIdle;  // said again it begins anew: lock takes another direction
}

void RigCommander::stop() {
  stop_asked_ = rests_ = true;
  clear_asked_ = false;
}

void RigCommander::clear() {
  stop_asked_ = false;
  clear_asked_ = rests_ = true;
}

void RigCommander::close() {
  closed_ = true;
}

void RigCommander::hear(const wire::RigState& state, MonotonicTime now) {
  if (state_) gaps_ = {gaps_[1], now - heard_};
  if (state_ && state.time < state_->time) {  // the host's clock was set back
    ordered_ = std::min(ordered_, state.time);
    if (turns_ahead_until_) turns_ahead_until_ = state.time + options_.turned;
  }
  state_ = state;
  heard_ = now;
  rests_ = rests_ || state.stopped;
  if (clear_asked_ && !state.stopped && !is_faulted()) clear_asked_ = false;
  if (is_any(RigAxisCondition::kUnknown) || is_any(RigAxisCondition::kHoming)) {
    turns_ahead_until_ = state.time + options_.turned;
  } else if (state.mode == RigMode::kNeutral && state.on_target) {
    turns_ahead_until_.reset();
  }
  if (!state.has_imu || !state.imu.attitude_known) return;
  if (!views_.empty() && state.imu.time < views_.back().time)
    views_.clear();  // the host's clock was set back
  if (!views_.empty() && state.imu.time == views_.back().time) return;
  views_.push_back({state.imu.time, state.imu.world_from_head * Eigen::Vector3d::UnitX()});
  while (views_.back().time - views_.front().time > options_.kept) views_.pop_front();
}

/// Directions have stamps of the IMU's, images those of the camera: where they are not known to differ,
/// they are taken to be the same.
std::optional<Eigen::Vector3d> RigCommander::direction_at(Timestamp image) const {
  const auto offset = state_ ? wire::camera_offset(*state_) : std::nullopt;
  const Timestamp time = image + std::chrono::nanoseconds(offset.value_or(0));
  const auto after = std::lower_bound(views_.begin(), views_.end(), time,
                                      [](const View& view, Timestamp t) { return view.time < t; });
  if (after == views_.end()) {
    if (views_.empty() || time - views_.back().time > options_.near) return std::nullopt;
    return views_.back().direction;
  }
  if (after == views_.begin() && after->time - time > options_.near) return std::nullopt;  // forgotten
  return after->direction;
}

void RigCommander::remember(MapId map, const Eigen::Vector3d& direction) {
  const auto known = std::find_if(seen_at_.begin(), seen_at_.end(),
                                  [map](const Heading& heading) { return heading.map == map; });
  if (known != seen_at_.end()) {
    known->direction = direction;
    std::rotate(seen_at_.begin(), known, known + 1);
    return;
  }
  seen_at_.insert(seen_at_.begin(), {map, direction});
  if (seen_at_.size() > wire::kMaxFurtherDirections + 1) seen_at_.pop_back();
}

/// Whether the search that was asked for goes past this sight, which is kept for later: at the edge of a map
/// a few points are in sight, and a better view is near.
bool RigCommander::passes_by(const RigSight& sight, const std::optional<Eigen::Vector3d>& direction) {
  const bool would_do = has_found_enough() || std::holds_alternative<NothingBetter>(found_);
  if (aim_ != RigAim::kSearch || !sight.poor || would_do || !state_ || !direction) return false;
  if (std::holds_alternative<Nothing>(found_)) found_ = PoorView{*direction, state_->looked_at};
  looking_ = Looking::kSearching;
  return !is_round_over();
}

/// The share of places looked at begins anew with each round. It also falls a little where a sway brings
/// other places within reach; a poor view is then taken early, no worse.
bool RigCommander::is_round_over() const {
  const auto* poor_view = std::get_if<PoorView>(&found_);
  return poor_view != nullptr && state_ && state_->looked_at < poor_view->looked_at / 2;
}

/// Back to the poor view, as a place where the camera may be found.
void RigCommander::look_again() {
  looking_ = Looking::kAtCandidate;
  candidate_at_ = std::get<PoorView>(found_).direction;
  candidate_since_.reset();
  found_ = NothingBetter();
}

void RigCommander::see(const RigSight& sight) {
  if (sight.target) sighting_ = sight;
  if (sight.tracked) {
    const auto direction = direction_at(sight.time);
    if (direction) remember(sight.map, *direction);
    lost_since_.reset();
    if (passes_by(sight, direction)) return;
    found_ = Enough();
    looking_ = Looking::kNot;
    return;
  }
  if (!sight.lost) {
    lost_since_.reset();
    return;
  }
  if (has_found_enough()) found_ = Nothing();
  if (is_round_over() && looking_ != Looking::kAtCandidate) look_again();
  if (!lost_since_) lost_since_ = sight.time;
  if (looking_ == Looking::kAtCandidate) {
    if (sight.verifying || !candidate_since_) candidate_since_ = sight.time;
    if (sight.time - *candidate_since_ <= options_.candidate_time) return;
    looking_ = Looking::kSearching;  // it was none
    if (std::holds_alternative<NothingBetter>(found_)) found_ = Nothing();
  }
  if (looking_ == Looking::kNot && aim_ != RigAim::kNeutral &&
      sight.time - *lost_since_ >= options_.search_after) {
    looking_ = Looking::kSearching;
    ++counts_.searches;
  }
}

/// The image that was asked about is of a while ago: the camera turns back to where it looked then.
void RigCommander::try_place(Timestamp asked) {
  const bool is_search = looking_ != Looking::kNot || aim_ == RigAim::kSearch;
  const auto direction = direction_at(asked);
  if (!is_search || !direction || looking_ == Looking::kAtCandidate) return;
  looking_ = Looking::kAtCandidate;
  candidate_at_ = *direction;
  candidate_since_.reset();
  ++counts_.candidates;
}

bool RigCommander::is_faulted() const {
  return state_ && std::any_of(state_->axes.begin(), state_->axes.end(),
                               [](const wire::RigAxisState& axis) { return axis.fault != 0; });
}

bool RigCommander::is_any(RigAxisCondition condition) const {
  return state_ && std::any_of(state_->axes.begin(), state_->axes.end(),
                               [&](const wire::RigAxisState& axis) { return axis.condition == condition; });
}

bool RigCommander::is_heard(MonotonicTime now) const {
  const auto gap = std::min<std::chrono::nanoseconds>(std::min(gaps_[0], gaps_[1]), options_.longest_gap);
  return state_ &&
         now - heard_ <= std::max<std::chrono::nanoseconds>(options_.gone, options_.missed_states * gap);
}

wire::RigCommand RigCommander::aimed() const {
  wire::RigCommand order;
  order.mode = mode_of(aim_);
  if (looking_ == Looking::kAtCandidate) {
    order.mode = RigMode::kLock;
    order.target = candidate_at_;
  } else if (looking_ == Looking::kSearching || aim_ == RigAim::kSearch) {
    // Who is found is not led away.
    order.mode = has_found_enough() ? RigMode::kLock : RigMode::kSearch;
    order.pattern = pattern_;
    if (has_found_enough() || seen_at_.empty()) return order;
    order.target = seen_at_.front().direction;
    for (auto heading = seen_at_.begin() + 1; heading != seen_at_.end(); ++heading)
      order.further.push_back(heading->direction);
  } else if (aim_ == RigAim::kFixate && sighting_) {
    order.target = *sighting_->target;
    order.seen = sighting_->time;
  }
  return order;
}

wire::RigCommand RigCommander::wanted() const {
  wire::RigCommand order;
  if (stop_asked_ && !(state_ && state_->stopped)) {
    order.mode = RigMode::kStop;
  } else if (clear_asked_ && !closed_) {
    order.mode = state_->stopped ? RigMode::kClearStop : RigMode::kClear;
  } else if (closed_ || rests_) {
    order.mode = RigMode::kIdle;
  } else if (is_any(RigAxisCondition::kUnknown) || is_any(RigAxisCondition::kHoming)) {
    order.mode = RigMode::kHome;
  } else if (turns_ahead_until_ && state_->time < *turns_ahead_until_) {  // homing ends where the stops are
    order.mode = RigMode::kNeutral;
  } else {
    order = aimed();
  }
  return order;
}

/// An order that was refused, or of which nothing is done any more. An axis with a fault waits for a person.
bool RigCommander::is_due_again(const wire::RigCommand& order) const {
  if (!state_ || state_->time - ordered_ < options_.anew) return false;
  const bool is_judged = state_->order == order_.order;
  if (!is_judged && state_->order.session == order_.order.session) return false;  // it will be
  if (is_judged && !state_->refusal.empty()) return true;
  return moves(order.mode) && state_->drives_idle && !is_faulted() && !state_->stopped;
}

std::optional<wire::RigCommand> RigCommander::command(MonotonicTime now) {
  // A stop, and that the drives may go, are said to who is not heard, too: it may hear.
  const bool ends = stop_asked_ || (closed_ && order_.order.seq != 0);
  if (!is_heard(now) && !ends) return std::nullopt;
  wire::RigCommand order = wanted();
  order.rig = rig_;
  order.commander = name_;
  order.order = order_.order;
  // A search begins where it is told to; what moves then is no other order. Nor is a sighting.
  const bool is_other_target = order.mode == RigMode::kLock && order.target != order_.target;
  const bool is_new =
      order_.order.seq == 0 || order.mode != order_.mode || is_other_target || is_due_again(order);
  if (is_new) {
    ++order.order.seq;
    ordered_ = state_ ? state_->time : Timestamp();
  } else if (order.mode == RigMode::kSearch) {
    order.target = order_.target;
    order.further = order_.further;
  }
  order_ = order;
  return order;
}

bool RigCommander::is_over() const {
  return closed_ && (!state_ || order_.order.seq == 0 ||
                     (order_.mode == RigMode::kIdle && state_->order == order_.order));
}

std::string RigCommander::describe(MonotonicTime now) const {
  const std::string rig = "rig " + rig_ + ": ";
  if (!state_) return rig + "is not there; is cairn-rig running on this host, in this domain?";
  if (!is_heard(now)) return rig + "has fallen silent";
  if (state_->stopped) return rig + "EMERGENCY STOP; c clears it";
  if (is_faulted()) return rig + state_->trouble + "; c clears the fault";
  if (state_->order == order_.order && !state_->refusal.empty()) return rig + state_->refusal;
  if (rests_) return rig + "idle; a key of a mode begins anew";
  if (state_->drives_idle && !state_->trouble.empty()) return rig + state_->trouble;
  std::string what(wire::name_of(state_->mode));
  if (looking_ == Looking::kAtCandidate) return rig + "looks at a place that may be it";
  if (state_->mode == RigMode::kSearch)
    what.append(" ").append(std::to_string(std::lround(kPercent * state_->looked_at))).append(" %");
  if (state_->mode == RigMode::kFixate && !state_->sees_target) what += ", no target in sight";
  if (state_->out_of_reach) what += ", out of reach";
  return rig + what;
}

}  // namespace cairn
