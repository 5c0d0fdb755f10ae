// SPDX-License-Identifier: Apache-2.0
#include "hw/app/bridge.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/utf8.h"

namespace cairn {
namespace {

using wire::RigMode;

constexpr size_t kSessions = 32;                         // remembered
constexpr size_t kGyroSamples = 4000;                    // some seconds
constexpr double kSetBack = 1;                           // [s] that no estimate of a sample's time is off
constexpr std::chrono::milliseconds kHeartbeatAge{120};  // then one is there that was sent after the order

/// Two processes of one name are two commanders.
std::string identity(const wire::RigCommand& command) {
  return fmt::format("{} (session {:x})", command.commander, command.order.session.value);
}

wire::RigAxisCondition condition_of(const Axis& axis) {
  using wire::RigAxisCondition;
  static_assert(std::variant_size_v<AxisState> == static_cast<size_t>(RigAxisCondition::kStopped) + 1);
  return static_cast<RigAxisCondition>(axis.state().index());  // both lists are in the same order
}

wire::RigAxisState state_of(const Axis& axis) {
  const auto fault = axis.fault();
  const auto position = axis.position();
  return {condition_of(axis), static_cast<uint8_t>(fault ? static_cast<int>(*fault) + 1 : 0),
          position.has_value(), position.value_or(0), axis.rate()};
}

std::string cut(const std::string& text, size_t most = wire::kMaxRigText) {
  return std::string(cut_text(one_line(text), std::min(most, wire::kMaxRigText)));
}

/// The search of an order: its directions are the ranked ones, the target before the further ones.
pointing::Search search_of(const wire::RigCommand& command) {
  pointing::Search search;
  if (command.pattern == wire::RigSearchPattern::kRaster) search.pattern = pointing::Search::Pattern::kRaster;
  if (!command.target.isZero(0)) search.ranked.push_back(command.target);
  for (const Eigen::Vector3d& direction : command.further) {
    if (!direction.isZero(0)) search.ranked.push_back(direction);
  }
  return search;
}

}  // namespace

RigBridge::RigBridge(const RigConfiguration& configuration, MonotonicTime now)
    : configuration_(configuration), rig_(configuration, now) {}

void RigBridge::set_camera_clock(const wire::RigCameraClock& clock) {
  camera_clock_ = clock;
  rig_.set_camera_offset(clock.known ? std::chrono::nanoseconds(clock.offset)
                                     : configuration_.calibration.offset);
}

std::vector<GyroSample> RigBridge::take_gyro() {
  return std::exchange(gyro_, {});
}

void RigBridge::obey(const wire::RigCommand& command, MonotonicTime now, MonotonicTime seen) {
  if (command.rig != configuration_.name) return;
  const std::string who = identity(command);
  // Who was refused, and is not the commander, does not become it by saying it again.
  if (who == rig_.commander() && !closed_) (void)rig_.take({who, rig_command::Stay{}}, now);
  const bool still_to_stop = command.mode == RigMode::kStop && !rig_.is_stopped();
  const bool is_new_one = is_new(command.order);
  if (!is_new_one && !still_to_stop) {
    if (command.order == said_.order && !closed_) (void)move_target(command, who, now, seen);
    return;
  }
  const Status done = carry_out(command, who, now);
  judged_ = command.order;
  refusal_ = done ? "" : done.error().message;
  ordered_by_ = command.commander;
  ordered_ = command.mode;
  if (!done || command.mode == RigMode::kStop) return;
  commander_ = command.commander;
  mode_ = command.mode;
  said_ = command;
  said_.seen = {};
  (void)move_target(command, who, now, seen);
}

/// Moves the target of the order that holds. A target that is faulty moves nothing, and the next one comes
/// soon.
Status RigBridge::move_target(const wire::RigCommand& command, const std::string& who, MonotonicTime now,
                              MonotonicTime seen) {
  const bool has_moved = command.target != said_.target || command.rates != said_.rates;
  const bool is_seen = command.seen > said_.seen && !command.target.isZero(0);
  said_ = command;
  if (command.mode == RigMode::kFixate)
    return is_seen ? rig_.take({who, rig_command::Sight{{seen, command.target}}}, now) : Status();
  const bool is_moved_by_hand = command.mode == RigMode::kJog || command.mode == RigMode::kLock;
  return is_moved_by_hand && has_moved ? rig_.take({who, rig_command::Aim{pointing_of(command)}}, now)
                                       : Status();
}

/// Whether an order is new; from then on it is not.
bool RigBridge::is_new(const wire::CommandId& order) {
  const auto known = std::find_if(newest_.begin(), newest_.end(), [&](const wire::CommandId& other) {
    return other.session == order.session;
  });
  if (known != newest_.end()) {
    const bool is_newer = order.seq > known->seq;
    if (is_newer) known->seq = order.seq;
    return is_newer;
  }
  newest_.push_back(order);
  if (newest_.size() > kSessions) newest_.pop_front();
  return true;
}

Status RigBridge::carry_out(const wire::RigCommand& command, const std::string& who, MonotonicTime now) {
  if (closed_) return fail(ErrorCode::kRefused, "the rig's program is ending; start it again");
  if (reserved_for_ && command.order.session != *reserved_for_ && command.mode != RigMode::kStop)
    return fail(ErrorCode::kRefused, "the rig is being calibrated; wait until that is over");
  switch (command.mode) {
    case RigMode::kIdle:
      return rig_.take({who, rig_command::Idle{}}, now);
    case RigMode::kHome:
      return rig_.take({who, rig_command::Home{}}, now);
    case RigMode::kClear:
      return rig_.take({who, rig_command::ClearFaults{}}, now);
    case RigMode::kStop:
      return rig_.take({who, rig_command::Stop{}}, now);
    case RigMode::kClearStop:
      return rig_.take({who, rig_command::ClearStop{command.rig}}, now);
    case RigMode::kNeutral:
    case RigMode::kFollow:
    case RigMode::kLock:
    case RigMode::kFixate:
    case RigMode::kSaccade:
    case RigMode::kSearch:
    case RigMode::kJog:
      return aim(command, who, now);
  }
  return fail(ErrorCode::kRefused, "an unknown mode");
}

Status RigBridge::aim(const wire::RigCommand& command, const std::string& who, MonotonicTime now) {
  const bool is_active = std::all_of(kAxisNames.begin(), kAxisNames.end(), [this](AxisName name) {
    const AxisState& state = rig_.axis(name).state();
    return std::holds_alternative<axis_state::Active>(state) ||
           std::holds_alternative<axis_state::Activating>(state);
  });
  if (!is_active) {
    if (Status activated = rig_.take({who, rig_command::Activate{}}, now); !activated) return activated;
  }
  Status aimed = rig_.take({who, rig_command::Aim{pointing_of(command)}}, now);
  if (!aimed && !is_active) (void)rig_.take({who, rig_command::Idle{}}, now);
  return aimed;
}

/// The pointing of an order whose mode looks at something.
Pointing RigBridge::pointing_of(const wire::RigCommand& command) const {
  const auto direction =
      command.target.isZero(0) ? std::nullopt : std::optional<Eigen::Vector3d>(command.target);
  switch (command.mode) {
    case RigMode::kJog:
      return pointing::Jog{{command.rates[0], command.rates[1]}};
    case RigMode::kFollow:
      return pointing::Follow{};
    case RigMode::kLock:
      return pointing::Lock{direction};
    case RigMode::kFixate:
      return pointing::Fixate{};
    case RigMode::kSaccade:
      return pointing::Saccade{direction, {command.angles[0], command.angles[1]}};
    case RigMode::kSearch:
      return search_of(command);
    default:
      return pointing::Neutral{{configuration_.axes[0].neutral, configuration_.axes[1].neutral}};
  }
}

void RigBridge::stop(MonotonicTime now) {
  (void)rig_.take({"the rig itself", rig_command::Stop{}}, now);
}

void RigBridge::close(MonotonicTime now) {
  closed_ = true;
  if (may_move()) let_go_ = now;
  (void)rig_.take({rig_.commander(), rig_command::Idle{}}, now);
}

bool RigBridge::is_let_go(MonotonicTime now) const {
  if (!let_go_) return true;
  return now - *let_go_ > kHeartbeatAge &&
         std::all_of(kAxisNames.begin(), kAxisNames.end(),
                     [this](AxisName name) { return rig_.axis(name).drive_is_idle(); });
}

bool RigBridge::may_move() const {
  return std::any_of(kAxisNames.begin(), kAxisNames.end(),
                     [this](AxisName name) { return rig_.axis(name).may_move(); });
}

void RigBridge::receive(const ReceivedFrame& frame, MonotonicTime now) {
  if (configuration_.imu) {
    if (const auto from_imu = xsens::decode(frame.frame)) sense(*from_imu, frame.stamp);
  }
  rig_.receive(frame.frame, now);
}

void RigBridge::sense(const xsens::Message& message, Timestamp received) {
  if (!imu_) imu_.emplace();
  if (const auto* time = std::get_if<xsens::SampleTime>(&message)) {
    imu_clock_.receive(time->ticks, received);
    imu_->time = imu_clock_.newest();
    imu_->clock_offset = imu_clock_.offset().value_or(0);
  } else if (const auto* turn = std::get_if<xsens::RateOfTurn>(&message)) {
    imu_->rate = Eigen::Vector3d(turn->rate.data()).cast<float>();
    if (gyro_.size() >= kGyroSamples) gyro_.clear();
    // Without a time of its own it would be taken for one at the time of the sample before.
    if (imu_clock_.offset() && (gyro_.empty() || imu_->time > gyro_.back().when))
      gyro_.push_back({imu_->time, Eigen::Vector3d(turn->rate.data())});
  } else if (const auto* pull = std::get_if<xsens::Acceleration>(&message)) {
    imu_->acceleration = Eigen::Vector3d(pull->acceleration.data()).cast<float>();
  }
  if (const auto sample = sampler_.receive(message)) keep(*sample);
}

/// A clock that was set back begins anew; the estimate of when a sample was taken is a little off at times.
void RigBridge::keep(const ImuSample& sample) {
  const Timestamp time = imu_clock_.newest();
  const double step = samples_.empty() ? 1 : seconds_between(time, samples_.back().time);
  if (step < -kSetBack) samples_.clear();
  if (step <= 0 && !samples_.empty()) return;
  samples_.push_back({time, sample.rate.cast<float>(), sample.acceleration.cast<float>()});
  if (samples_.size() > wire::kMaxRigSamples) samples_.pop_front();
}

/// The mode that is carried out, which may be less than was ordered.
RigMode RigBridge::mode() const {
  if (rig_.is_stopped()) return RigMode::kStop;
  return may_move() ? mode_ : RigMode::kIdle;
}

wire::RigState RigBridge::state(Timestamp host_time) const {
  wire::RigState state;
  state.rig = configuration_.name;
  state.time = host_time;
  state.mode = mode();
  state.commander = commander_;
  state.order = judged_;
  state.refusal = cut(refusal_);
  state.stopped = rig_.is_stopped();
  state.drives_idle = !may_move();
  for (const AxisName name : kAxisNames) state.axes.at(static_cast<size_t>(name)) = state_of(rig_.axis(name));
  state.has_imu = imu_.has_value();
  if (imu_) {
    state.imu = *imu_;
    state.imu.attitude_known = rig_.attitude().is_known();
    // x is where the camera looks: what a tracker saw there, it aims at again.
    state.imu.world_from_head = rig_.attitude().world_from_imu() *
                                configuration_.calibration.head_from_camera *
                                nominal_head_from_camera().conjugate();
  }
  if (const auto pointing = rig_.pointing()) {
    state.on_target = pointing->on_target;
    state.out_of_reach = pointing->out_of_reach;
    state.sees_target = pointing->sees_target;
    state.looked_at = static_cast<float>(pointing->looked_at);
    state.rounds = static_cast<uint32_t>(pointing->rounds);
  }
  state.camera_clock = camera_clock_;
  state.ordered_by = ordered_by_;
  state.ordered = ordered_;
  const std::string of_rig = rig_.describe();
  state.trouble = cut(bus_trouble_ + (bus_trouble_.empty() || of_rig.empty() ? "" : ". ") + of_rig,
                      wire::kMaxRigTexts - state.refusal.size());
  tell_tracker(&state);
  return state;
}

void RigBridge::tell_tracker(wire::RigState* state) const {
  state->samples.assign(samples_.begin(), samples_.end());
  const RigCalibration& calibration = configuration_.calibration;
  if (calibration.knows_mounts) state->camera_from_imu = calibration.camera_from_imu();
  if (calibration.knows_offset) state->calibrated_offset = calibration.offset.count();
  if (const auto angles = rig_.angles())
    state->base_from_camera = base_from_head(*angles) * calibration.head_from_camera;
}

}  // namespace cairn
