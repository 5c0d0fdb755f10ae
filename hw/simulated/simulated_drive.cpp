// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/simulated_drive.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace cairn::simulated {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kStep{1};
constexpr double kStepSeconds = 1e-3;
constexpr double kFading = 0.92;  // a step, of eight cycles of the firmware
constexpr uint8_t kSuccess = 0;
constexpr uint8_t kBusy = 1;
constexpr uint8_t kDisarmed = 3;

}  // namespace

SimulatedDrive::SimulatedDrive(const DriveOptions& options, uint32_t seed, MonotonicTime now)
    : options_(options), plant_(options.plant), now_(now), fed_(now) {
  std::mt19937 random(seed);
  const auto phase = [&](milliseconds period) {
    return period.count() == 0 ? milliseconds(0) : milliseconds(random() % period.count());
  };
  next_heartbeat_ = now + phase(options.heartbeat);
  next_estimates_ = now + phase(options.estimates);
  limits_ = {static_cast<float>(options.velocity_limit), static_cast<float>(options.current_limit)};
}

void SimulatedDrive::receive(const CanFrame& frame) {
  if (muted_ || boots_until_) return;
  const std::array<odrive::Node, 1> self = {options_.node};
  const auto decoded = odrive::decode(frame, self);
  if (decoded) std::visit([this](const auto& message) { handle(message); }, decoded->message);
}

void SimulatedDrive::handle(const odrive::SetAxisState& message) {
  using odrive::AxisState;
  if (message.state == AxisState::kIdle) {
    state_ = AxisState::kIdle;
    return;
  }
  if (message.state == state_ || errors_ != 0) return;
  if (message.state == AxisState::kClosedLoop) {
    input_ = {position(), 0, 0};
    fed_ = now_;
  } else if (message.state == AxisState::kHoming) {
    leaves_switch_ = plant_.angle() <= options_.switch_angle;
    input_ = {position(), 0, 0};
    result_ = kBusy;
  } else {
    return;
  }
  integral_ = 0;
  state_ = message.state;
}

void SimulatedDrive::handle(const odrive::SetInputPosition& message) {
  fed_ = now_;
  input_.position = message.position;
  input_.velocity = message.velocity_feedforward;
}

void SimulatedDrive::handle(const odrive::SetLimits& message) {
  limits_.velocity = std::clamp(message.velocity, 0.0F, static_cast<float>(options_.velocity_limit));
  limits_.current = std::clamp(message.current, 0.0F, static_cast<float>(options_.current_limit));
}

void SimulatedDrive::handle(odrive::Request request) {
  asked_.push_back(request);
}

void SimulatedDrive::reset() {
  state_ = odrive::AxisState::kIdle;
  mode_ = {};
  limits_ = {static_cast<float>(options_.velocity_limit), static_cast<float>(options_.current_limit)};
  zero_ = plant_.shaft();
  input_ = {};
  asked_.clear();
  result_ = kSuccess;
  errors_ = disarm_reason_ = 0;
  boots_until_ = now_ + options_.boot;
}

void SimulatedDrive::disarm(uint32_t error) {
  if (state_ != odrive::AxisState::kIdle) {
    disarm_reason_ |= error;
    result_ = kDisarmed;
  }
  errors_ |= error;
  state_ = odrive::AxisState::kIdle;
}

void SimulatedDrive::advance(MonotonicTime now, std::vector<CanFrame>& out) {
  send_due(out);
  while (now_ + kStep <= now) {
    now_ += kStep;
    if (boots_until_ && now_ >= *boots_until_) boots_until_.reset();
    step();
    send_due(out);
  }
}

void SimulatedDrive::step() {
  using odrive::AxisState;
  double current = 0;
  if (state_ == AxisState::kClosedLoop) {
    if (options_.watchdog.count() > 0 && now_ - fed_ > options_.watchdog) {
      disarm(odrive::kErrorWatchdogExpired);
    } else if (mode_.control == odrive::ControlMode::kPosition) {
      current = current_for(input_);
    }
  } else if (state_ == AxisState::kHoming) {
    step_homing();
    if (state_ == AxisState::kHoming) current = current_for(input_);
  }
  plant_.advance(current, kStepSeconds);
}

void SimulatedDrive::step_homing() {
  const bool at_switch = plant_.angle() <= options_.switch_angle;
  if (leaves_switch_) {
    leaves_switch_ = at_switch;
  } else if (at_switch) {
    zero_ = plant_.shaft();
    state_ = odrive::AxisState::kIdle;
    result_ = kSuccess;
    return;
  }
  const double rate = leaves_switch_ ? options_.homing_rate : -options_.homing_rate;
  input_ = {position(), rate, 0};
}

double SimulatedDrive::current_for(const Input& input) {
  const double limit = limits_.velocity;
  const double wanted =
      std::clamp(options_.position_gain * (input.position - position()) + input.velocity, -limit, limit);
  const double wrong = wanted - plant_.shaft_rate();
  const double current = options_.velocity_gain * wrong + integral_ + input.current;
  const double limited = std::clamp<double>(current, -limits_.current, limits_.current);
  // As in the firmware: at its limit the integral fades instead of growing.
  if (limited == current) {
    integral_ += options_.integrator_gain * wrong * kStepSeconds;
  } else {
    integral_ *= kFading;
  }
  return limited;
}

odrive::Message SimulatedDrive::estimates() const {
  const double counts = std::round(position() * options_.counts_per_turn);
  return odrive::EncoderEstimates{static_cast<float>(counts / options_.counts_per_turn),
                                  static_cast<float>(plant_.shaft_rate())};
}

void SimulatedDrive::send_due(std::vector<CanFrame>& out) {
  if (now_ >= next_heartbeat_) {
    next_heartbeat_ += options_.heartbeat;
    send(odrive::Heartbeat{errors_, state_, result_, false}, out);
  }
  if (options_.estimates.count() > 0 && now_ >= next_estimates_) {
    next_estimates_ += options_.estimates;
    send(estimates(), out);
  }
  for (const odrive::Request request : asked_) {
    if (request == odrive::Request::kErrors) {
      send(odrive::Errors{errors_, disarm_reason_}, out);
    } else {
      send(estimates(), out);
    }
  }
  asked_.clear();
}

void SimulatedDrive::send(const odrive::Message& message, std::vector<CanFrame>& out) const {
  if (muted_ || boots_until_) return;
  if (const auto frame = odrive::encode(options_.node, message)) out.push_back(*frame);
}

}  // namespace cairn::simulated
