// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/axis.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cairn {
namespace {

using namespace std::chrono_literals;

constexpr auto kHeartbeatDeadline = 550ms;  // drives send one each 100 ms; five are not lost by chance
constexpr auto kAnswerTime = 500ms;         // from a change of state asked for to the heartbeat that tells it

}  // namespace

Axis::Axis(const AxisConfiguration& configuration, const RigTuning& tuning, std::chrono::milliseconds period,
           std::chrono::milliseconds deadline, MonotonicTime now)
    : configuration_(configuration),
      options_(tuning.axis),
      stall_(tuning.stall),
      period_(period),
      deadline_(deadline),
      state_(axis_state::Unknown()),
      estimated_(now),
      heartbeat_(now) {}

std::optional<AxisFault> Axis::fault() const {
  const auto* faulted = std::get_if<axis_state::Faulted>(&state_);
  return faulted == nullptr ? std::nullopt : std::optional(faulted->fault);
}

bool Axis::may_move() const {
  return std::holds_alternative<axis_state::Homing>(state_) ||
         std::holds_alternative<axis_state::Activating>(state_) ||
         std::holds_alternative<axis_state::Active>(state_);
}

std::optional<double> Axis::position() const {
  return homed_ ? position_ : std::nullopt;
}

Status Axis::home(MonotonicTime now) {
  if (!std::holds_alternative<axis_state::Unknown>(state_) &&
      !std::holds_alternative<axis_state::Idle>(state_))
    return fail(ErrorCode::kRefused, "only an idle axis without a fault can be homed");
  homed_ = false;
  state_ = axis_state::Homing{now};
  return {};
}

Status Axis::activate(MonotonicTime now) {
  if (std::holds_alternative<axis_state::Unknown>(state_))
    return fail(ErrorCode::kRefused, "it is not known where the axis stands; home it first");
  if (!std::holds_alternative<axis_state::Idle>(state_))
    return fail(ErrorCode::kRefused, "only an idle axis without a fault can be activated");
  if (!position_) return fail(ErrorCode::kRefused, "its drive has not told yet where the axis stands");
  if (*position_ < configuration_.limits.low || *position_ > configuration_.limits.high)
    return fail(ErrorCode::kRefused, "the axis stands beyond its limits; turn it back by hand or home it");
  demand_ = {*position_, 0};
  state_ = axis_state::Activating{now};
  return {};
}

void Axis::idle() {
  if (may_move()) rest();
}

void Axis::clear(MonotonicTime now) {
  if (fault()) begin_clearing(now);
}

void Axis::stop() {
  state_ = axis_state::Stopped();
  out_ = {odrive::Estop{}, odrive::SetAxisState{odrive::AxisState::kIdle}};
}

void Axis::release(MonotonicTime now) {
  if (std::holds_alternative<axis_state::Stopped>(state_)) begin_clearing(now);
}

void Axis::begin_clearing(MonotonicTime now) {
  state_ = axis_state::Clearing{now};
  estimated_ = heartbeat_ = now;  // its silence counts anew
}

/// Comes to rest: the drive is told to be idle. Setpoints that wait to be sent are dropped, for they must not
/// follow.
void Axis::rest() {
  out_ = {odrive::SetAxisState{odrive::AxisState::kIdle}};
  if (homed_) {
    state_ = axis_state::Idle();
  } else {
    state_ = axis_state::Unknown();
  }
}

void Axis::fail_with(AxisFault fault, uint32_t errors) {
  if (fault == AxisFault::kReset || fault == AxisFault::kSilent) {
    homed_ = false;
    position_.reset();
  }
  if (this->fault() || std::holds_alternative<axis_state::Stopped>(state_))
    return;  // the first one tells why
  rest();
  state_ = axis_state::Faulted{fault, errors};
}

void Axis::receive(const odrive::Message& message, MonotonicTime now) {
  if (const auto* heartbeat = std::get_if<odrive::Heartbeat>(&message)) take(*heartbeat, now);
  if (const auto* estimates = std::get_if<odrive::EncoderEstimates>(&message)) take(*estimates, now);
}

void Axis::take(const odrive::Heartbeat& heartbeat, MonotonicTime now) {
  heartbeat_ = now;
  drive_ = heartbeat.state;
  drive_errors_ = heartbeat.axis_error;
  if (auto* clearing = std::get_if<axis_state::Clearing>(&state_)) {
    // One that was on its way may still be of the time before.
    if (drive_errors_ == 0 && now > clearing->since + period_) rest();
    return;
  }
  if (drive_errors_ != 0) {
    const bool watchdog = drive_errors_ == odrive::kErrorWatchdogExpired;
    fail_with(watchdog ? AxisFault::kWatchdog : AxisFault::kDriveError, drive_errors_);
  } else if (std::holds_alternative<axis_state::Homing>(state_)) {
    leave_homing(heartbeat);
  } else if (std::holds_alternative<axis_state::Activating>(state_)) {
    if (heartbeat.state == odrive::AxisState::kClosedLoop && position_) {
      state_ = axis_state::Active{MotionProfile(configuration_.limits, period_seconds(), *position_),
                                  StallWatch(period_seconds(), stall_)};
    }
  } else if (std::holds_alternative<axis_state::Active>(state_) &&
             heartbeat.state != odrive::AxisState::kClosedLoop) {
    fail_with(AxisFault::kReset);
  }
}

void Axis::leave_homing(const odrive::Heartbeat& heartbeat) {
  auto& homing = std::get<axis_state::Homing>(state_);
  if (heartbeat.state == odrive::AxisState::kHoming) {
    homing.begun = true;
  } else if (homing.begun) {
    if (heartbeat.state != odrive::AxisState::kIdle || heartbeat.procedure_result != 0)
      return fail_with(AxisFault::kHoming);
    homed_ = true;
    position_.reset();  // told from another zero
    rest();
  }
}

bool Axis::has_jumped(double angle, MonotonicTime now) const {
  const double elapsed = std::chrono::duration<double>(now - estimated_).count();
  return homed_ && position_ &&
         std::abs(angle - *position_) >
             options_.jump + options_.jump_rate * configuration_.limits.rate * elapsed;
}

void Axis::take(const odrive::EncoderEstimates& estimates, MonotonicTime now) {
  const double angle = configuration_.home + estimates.position / configuration_.turns_per_radian;
  const bool jumped = has_jumped(angle, now);
  estimated_ = now;
  position_ = angle;
  rate_ = estimates.velocity / configuration_.turns_per_radian;
  if (jumped) return fail_with(AxisFault::kReset);
  check_limits();
}

void Axis::check_limits() {
  const MotionLimits& limits = configuration_.limits;
  if (!homed_ || !may_move()) return;
  if (*position_ < limits.low || *position_ > limits.high ||
      std::abs(rate_) > options_.runaway_rate * limits.rate)
    fail_with(AxisFault::kOverLimit);
}

void Axis::check_silence(MonotonicTime now) {
  if (now - estimated_ > deadline_ || now - heartbeat_ > kHeartbeatDeadline) {
    drive_.reset();
    return fail_with(AxisFault::kSilent);
  }
  if (!drive_ || !position_) return;
  // One that comes late, as with its bus: nothing was known of it that could be wrong now.
  if (!std::exchange(heard_, true) && fault() == AxisFault::kSilent) rest();
}

void Axis::advance(MonotonicTime now) {
  check_silence(now);
  if (now - estimated_ > period_ + period_ / 2)
    out_.emplace_back(odrive::Request::kEncoderEstimates);  // a drive that does not send them by itself
  std::visit([&](auto& state) { go_on(state, now); }, state_);
}

/// Told again until a heartbeat says so: frames may be lost.
void Axis::keep_idle() {
  if (drive_ != odrive::AxisState::kIdle) out_.emplace_back(odrive::SetAxisState{odrive::AxisState::kIdle});
}

void Axis::go_on(axis_state::Homing& state, MonotonicTime now) {
  if (now - state.since > (state.begun ? options_.homing_time : kAnswerTime))
    return fail_with(AxisFault::kHoming);
  if (!state.begun) {
    out_.emplace_back(
        odrive::SetLimits{static_cast<float>(options_.rate_headroom * configuration_.limits.rate *
                                             std::abs(configuration_.turns_per_radian)),
                          static_cast<float>(configuration_.current)});
    out_.emplace_back(odrive::SetAxisState{odrive::AxisState::kHoming});
  }
}

void Axis::go_on(axis_state::Activating& state, MonotonicTime now) {
  if (now - state.since > kAnswerTime) return fail_with(AxisFault::kNotActivated);
  if (!position_) return;
  out_.emplace_back(
      odrive::SetControllerMode{odrive::ControlMode::kPosition, odrive::InputMode::kPassthrough});
  out_.emplace_back(odrive::SetLimits{static_cast<float>(options_.rate_headroom * configuration_.limits.rate *
                                                         std::abs(configuration_.turns_per_radian)),
                                      static_cast<float>(configuration_.current)});
  set_input({*position_, 0});
  out_.emplace_back(odrive::SetAxisState{odrive::AxisState::kClosedLoop});
}

void Axis::go_on(axis_state::Active& state, MonotonicTime now) {
  state.profile.advance(demand_);
  set_input(state.profile.for_axis_at(*position_at(now)));
  if (state.stall.is_stuck(state.profile.position(), *position_)) fail_with(AxisFault::kStuck);
}

void Axis::go_on(axis_state::Clearing& state, MonotonicTime now) {
  if (now - state.since > kAnswerTime) return fail_with(AxisFault::kDriveError, drive_errors_);
  out_.emplace_back(odrive::ClearErrors{});
  keep_idle();
}

void Axis::go_on(axis_state::Stopped&, MonotonicTime) {
  if (drive_ != odrive::AxisState::kIdle || drive_errors_ == 0) out_.emplace_back(odrive::Estop{});
  keep_idle();
}

std::optional<double> Axis::position_at(MonotonicTime now) const {
  if (!position()) return std::nullopt;
  return *position_ + rate_ * std::chrono::duration<double>(now - estimated_).count();
}

void Axis::set_input(const Setpoint& setpoint) {
  out_.emplace_back(odrive::SetInputPosition{
      static_cast<float>((setpoint.position - configuration_.home) * configuration_.turns_per_radian),
      static_cast<float>(setpoint.rate * configuration_.turns_per_radian), 0});
}

}  // namespace cairn
