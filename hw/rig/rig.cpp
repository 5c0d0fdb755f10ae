// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/rig.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "hw/can/strange_frame.h"

namespace cairn {
namespace {

bool is_urgent(const odrive::Message& message) {
  const auto* state = std::get_if<odrive::SetAxisState>(&message);
  return std::holds_alternative<odrive::Estop>(message) ||
         (state != nullptr && state->state == odrive::AxisState::kIdle);
}

bool is_finite(const Demand& demand) {
  return std::isfinite(demand.position.value_or(0)) && std::isfinite(demand.rate);
}

/// "pan (node 16) does not answer; check ..."
std::string tell(AxisName name, odrive::Node node, AxisFault fault) {
  return std::string(to_string(name)) + " (node " + std::to_string(node.value) + ") " + describe(fault);
}

tl::unexpected<Error> refuse(std::string why) {
  return fail(ErrorCode::kRefused, std::move(why));
}

}  // namespace

const char* describe(Halt halt) {
  switch (halt) {
    case Halt::kCommanderSilent:
      return "the commander fell silent; start it again and activate the rig";
    case Halt::kImuSilent:
      return "the IMU does not answer; check its supply, its plug and the bit rate";
    case Halt::kImuRate:
      return "the IMU samples at another rate than `imu: rate:` says; change one of them";
    case Halt::kAxisFault:
      return "an axis has a fault";
    case Halt::kClockRanBack:
      return "the clock ran back; activate the rig again";
  }
  return "";
}

Rig::Rig(const RigConfiguration& configuration, MonotonicTime now)
    : configuration_(configuration),
      nodes_(configuration.nodes()),
      axes_{Axis(configuration.axes[0], configuration.tuning, configuration.period,
                 configuration.drive_deadline, now),
            Axis(configuration.axes[1], configuration.tuning, configuration.period,
                 configuration.drive_deadline, now)},
      attitude_(configuration.tuning.attitude),
      backlash_{Backlash(configuration.axes[0].backlash, configuration.tuning.backlash),
                Backlash(configuration.axes[1].backlash, configuration.tuning.backlash)},
      pointer_(configuration),
      now_(now),
      next_(now + configuration.period) {
  if (configuration.imu)
    imu_.emplace(configuration.imu->rate, configuration.tuning.timing.imu_rate_off,
                 configuration.imu_deadline, now);
}

Status Rig::take(const RigCommand& command, MonotonicTime now) {
  const bool is_stop = std::holds_alternative<rig_command::Stop>(command.what);
  const bool frees = stopped_ && std::holds_alternative<rig_command::ClearStop>(command.what);
  const bool alive = !commander_.empty() && now - commanded_ <= configuration_.commander_deadline;
  if (!is_stop && !frees && alive && command.commander != commander_)
    return refuse("the rig is commanded by " + commander_ + "; end that one first");
  const bool is_other = !is_stop && !frees && command.commander != commander_;
  if (Status done = std::visit([&](const auto& what) { return handle(what, now); }, command.what); !done)
    return done;
  if (is_other) pointer_.forget_search();  // what the other one has looked for is another camera
  if (!is_stop && !frees) {
    commander_ = command.commander;
    commanded_ = now;
  }
  collect();
  return {};
}

Status Rig::ready() const {
  if (stopped_) return refuse("the rig is stopped; clear the emergency stop first");
  for (const AxisName name : kAxisNames) {
    if (const auto fault = axis(name).fault())
      return refuse(tell(name, configuration_.axis(name).node, *fault));
  }
  return {};
}

Status Rig::handle(const rig_command::Home&, MonotonicTime now) {
  if (Status is_ready = ready(); !is_ready) return is_ready;
  return begin(&Axis::home, now);
}

Status Rig::handle(const rig_command::Activate&, MonotonicTime now) {
  if (Status is_ready = ready(); !is_ready) return is_ready;
  if (const auto trouble = imu_trouble(now)) return refuse(cairn::describe(*trouble));
  if (Status begun = begin(&Axis::activate, now); !begun) return begun;
  pointer_.let_go();
  return {};
}

/// Begins with both axes, or leaves both as they were.
Status Rig::begin(Status (Axis::*what)(MonotonicTime), MonotonicTime now) {
  auto begun = axes_;
  for (Axis& axis : begun) {
    if (Status done = (axis.*what)(now); !done) return done;
  }
  axes_ = std::move(begun);
  halt_.reset();
  return {};
}

Status Rig::handle(const rig_command::Idle&, MonotonicTime) {
  for (Axis& axis : axes_) axis.idle();
  return {};
}

Status Rig::handle(const rig_command::Point& point, MonotonicTime) {
  if (!std::all_of(point.demands.begin(), point.demands.end(), is_finite))
    return refuse("a demand that is no number moves nothing");
  for (size_t i = 0; i < axes_.size(); ++i) axes_.at(i).demand(point.demands.at(i));
  pointer_.let_go();
  return {};
}

Status Rig::handle(const rig_command::ClearFaults&, MonotonicTime now) {
  for (Axis& axis : axes_) axis.clear(now);
  return {};
}

Status Rig::handle(const rig_command::Stop&, MonotonicTime) {
  stopped_ = true;
  out_.clear();
  for (Axis& axis : axes_) axis.stop();
  return {};
}

Status Rig::handle(const rig_command::ClearStop& clear, MonotonicTime now) {
  if (clear.rig != configuration_.name)
    return refuse("this rig is " + configuration_.name + "; its stop is cleared by that name only");
  stopped_ = false;
  for (Axis& axis : axes_) axis.release(now);
  return {};
}

void Rig::receive(const CanFrame& frame, MonotonicTime now) {
  if (const auto from_drive = odrive::decode(frame, nodes_)) {
    axes_.at(from_drive->node == nodes_[0] ? 0 : 1).receive(from_drive->message, now);
  } else if (const auto from_imu = xsens::decode(frame)) {
    if (imu_) sense(*from_imu, now);
  } else {
    ++counters_.strange_frames;
    strange_ = frame;
  }
  watch(now);
  collect();
}

void Rig::sense(const xsens::Message& message, MonotonicTime now) {
  imu_->receive(message, now);
  const auto sample = sampler_.receive(message);
  if (!sample) return;
  const Eigen::Quaterniond& head_from_imu = configuration_.calibration.head_from_imu;
  const std::optional<PanTilt> angles = angles_at(now);
  attitude_.update(head_from_imu * sample->rate, head_from_imu * sample->acceleration, sample->step,
                   turn_of_head(angles));
  angles_ = angles;
  fall_in_step(now);
  if (!attitude_.is_known() || !angles) return;
  pointer_.sense(now, attitude_.world_from_imu(), head_from_imu * sample->acceleration, *angles,
                 sample->step);
}

std::optional<PanTilt> Rig::angles_at(MonotonicTime now) {
  const auto pan = axes_[0].position_at(now);
  const auto tilt = axes_[1].position_at(now);
  if (!pan || !tilt) return std::nullopt;
  return PanTilt{backlash_[0].follow(*pan), backlash_[1].follow(*tilt)};
}

Eigen::Vector3d Rig::turn_of_head(const std::optional<PanTilt>& angles) const {
  if (!angles || !angles_) return Eigen::Vector3d::Zero();
  return rate_of_head(*angles, {angles->pan - angles_->pan, angles->tilt - angles_->tilt});
}

/// Little by little, so that setpoints stay a period apart.
void Rig::fall_in_step(MonotonicTime sampled) {
  const RigTimingOptions& timing = configuration_.tuning.timing;
  const double period = std::chrono::duration<double>(configuration_.period).count();
  const double samples = period * configuration_.imu->rate;
  if (samples < 0.5 || std::abs(samples - std::round(samples)) > timing.in_step) return;
  const double due = std::chrono::duration<double>(next_ - sampled).count();
  const double late = std::remainder(due - timing.behind_sample, 1 / configuration_.imu->rate);
  const double shift = std::clamp(late, -timing.step_share * period, timing.step_share * period);
  next_ -= std::chrono::nanoseconds(std::llround(shift * 1e9));
}

/// A setpoint holds for a period: it is to be right in the middle of it. The profile adds a whole one.
void Rig::aim(MonotonicTime now) {
  auto demands = pointer_.demands(now - configuration_.period / 2, axes_[0].position().value_or(0));
  if (!demands) return;
  for (size_t i = 0; i < axes_.size(); ++i) {
    Demand& demand = demands->at(i);
    if (demand.position) demand.position = backlash_.at(i).motor_for(*demand.position, demand.rate);
    axes_.at(i).demand(demand);
  }
}

void Rig::advance(MonotonicTime now) {
  if (now < now_) {
    next_ = now + configuration_.period;
    halt_for(Halt::kClockRanBack);
  }
  now_ = now;
  if (now - next_ > configuration_.tuning.timing.most_periods * configuration_.period) {
    ++counters_.late;
    next_ = now;
  }
  for (; next_ <= now; next_ += configuration_.period) {
    aim(next_);
    for (Axis& axis : axes_) axis.advance(next_);
    watch(next_);
    collect();
  }
}

std::optional<PanTilt> Rig::angles() const {
  const auto pan = axes_[0].position_at(now_);
  const auto tilt = axes_[1].position_at(now_);
  if (!pan || !tilt || axes_[0].fault() || axes_[1].fault()) return std::nullopt;
  return PanTilt{*pan, *tilt};
}

bool Rig::may_move() const {
  return std::any_of(axes_.begin(), axes_.end(), [](const Axis& axis) { return axis.may_move(); });
}

std::optional<Halt> Rig::imu_trouble(MonotonicTime now) const {
  if (!imu_) return std::nullopt;
  if (imu_->is_silent(now)) return Halt::kImuSilent;
  if (imu_->is_at_wrong_rate()) return Halt::kImuRate;
  return std::nullopt;
}

std::optional<Halt> Rig::what_is_wrong(MonotonicTime now) const {
  if (std::any_of(axes_.begin(), axes_.end(), [](const Axis& axis) { return axis.fault().has_value(); }))
    return Halt::kAxisFault;
  if (now - commanded_ > configuration_.commander_deadline) return Halt::kCommanderSilent;
  return imu_trouble(now);
}

void Rig::watch(MonotonicTime now) {
  if (!may_move()) return;
  if (const auto wrong = what_is_wrong(now)) halt_for(*wrong);
}

void Rig::halt_for(Halt reason) {
  if (may_move()) halt_ = reason;
  for (Axis& axis : axes_) axis.idle();
  collect();
}

void Rig::collect() {
  for (size_t i = 0; i < axes_.size(); ++i) {
    for (const odrive::Message& message : axes_.at(i).take_messages()) {
      const auto frame = odrive::encode(nodes_.at(i), message);
      if (frame) out_.push_back({*frame, is_urgent(message) ? Urgency::kUrgent : Urgency::kRoutine});
    }
  }
}

std::vector<OutgoingFrame> Rig::take_frames() {
  return std::exchange(out_, {});
}

std::string Rig::describe_strange() const {
  return strange_ ? cairn::describe_strange(*strange_, nodes_) : std::string();
}

std::string Rig::describe() const {
  std::string text;
  const auto add = [&text](const std::string& part) { text += (text.empty() ? "" : ". ") + part; };
  if (stopped_) add("emergency stop; clear it by the name " + configuration_.name);
  for (const AxisName name : kAxisNames) {
    if (const auto fault = axis(name).fault()) add(tell(name, configuration_.axis(name).node, *fault));
  }
  if (halt_ && *halt_ != Halt::kAxisFault) add(cairn::describe(*halt_));
  return text;
}

}  // namespace cairn
