// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/pointer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <utility>

namespace cairn {
namespace {

using Eigen::Vector3d;

constexpr double kGravity = 9.80665;  // [m/s^2]
constexpr double kSoonest = 1e-3;     // [s]
constexpr double kLeastView = 0.05;   // [rad]
constexpr double kMostView = 3;

bool is_direction(const Vector3d& direction) {
  return direction.allFinite() && direction.norm() > 0 && std::isfinite(direction.norm());
}

bool is_finite(const PanTilt& angles) {
  return std::isfinite(angles.pan) && std::isfinite(angles.tilt);
}

double angle_between(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

tl::unexpected<Error> refuse(std::string why) {
  return fail(ErrorCode::kRefused, std::move(why));
}

/// Whether a pointing makes sense: its numbers are finite, its directions have a length, its view is one that
/// a camera could have.
struct IsSound {
  bool operator()(const pointing::Neutral& neutral) const { return is_finite(neutral.angles); }
  bool operator()(const pointing::Jog& jog) const { return is_finite(jog.rates); }
  bool operator()(const pointing::Follow&) const { return true; }
  bool operator()(const pointing::Lock& lock) const {
    return !lock.direction || is_direction(*lock.direction);
  }
  bool operator()(const pointing::Fixate&) const { return true; }
  bool operator()(const pointing::Saccade& saccade) const {
    return is_finite(saccade.angles) && (!saccade.direction || is_direction(*saccade.direction));
  }
  bool operator()(const pointing::Search& search) const {
    const auto is_view = [](double view) { return view >= kLeastView && view <= kMostView; };
    return is_view(search.view.pan) && is_view(search.view.tilt) &&
           std::all_of(search.ranked.begin(), search.ranked.end(), is_direction);
  }
};

bool needs_imu(const Pointing& pointing) {
  return !std::holds_alternative<pointing::Neutral>(pointing) &&
         !std::holds_alternative<pointing::Jog>(pointing);
}

}  // namespace

Pointer::Pointer(const RigConfiguration& configuration)
    : configuration_(configuration),
      camera_axis_(configuration.calibration.head_from_camera * Vector3d::UnitZ()),
      base_(configuration.tuning.base),
      sway_(configuration.tuning.base),
      track_(configuration.tuning.target) {}

Status Pointer::aim(const Pointing& pointing) {
  if (!std::visit(IsSound(), pointing))
    return refuse("a number or a direction of that aim is not finite, 0, or no view of a camera");
  if (needs_imu(pointing) && !configuration_.imu)
    return refuse(std::string("this rig has no IMU and knows no ") + to_string(mode_of(pointing)) +
                  "; add `imu:` to its configuration");
  // Said again, a mode moves its target and does not begin anew.
  const auto again = pointing_ && pointing_->index() == pointing.index();
  const auto* lock = std::get_if<pointing::Lock>(&pointing);
  const auto* search = std::get_if<pointing::Search>(&pointing);
  const bool is_other_search = search != nullptr && plan_ && !plan_->is_for(*search);
  begun_ = again && begun_ && (lock == nullptr || !lock->direction.has_value()) && !is_other_search &&
           !std::holds_alternative<pointing::Saccade>(pointing);
  pointing_ = pointing;
  if (search != nullptr && plan_ && !is_other_search) plan_->rank(search->ranked);
  return {};
}

Status Pointer::see(const Sighting& sighting) {
  if (!is_direction(sighting.target))
    return refuse("a sighting at no distance, or of no number, shows nothing");
  const MonotonicTime when = sighting.when + configuration_.calibration.offset;
  const auto head = history_.at(when);
  if (!head) return refuse("a sighting of the future or of more than a second ago tells nothing");
  // From where the head would be without the steps: they would be no even motion.
  track_.see(when, head->world_from_head * (configuration_.calibration.head_from_camera * sighting.target) +
                       head->way);
  return {};
}

void Pointer::forget_search() {
  plan_.reset();
  if (pointing_ && std::holds_alternative<pointing::Search>(*pointing_)) begun_ = false;
}

void Pointer::sense(MonotonicTime now, const Eigen::Quaterniond& world_from_head,
                    const Eigen::Vector3d& acceleration, const PanTilt& angles, double step) {
  sway_.update(world_from_head * acceleration - kGravity * Vector3d::UnitZ(), step);
  base_.update(world_from_head, angles, now - sampled_ > configuration_.tuning.pointer.gap ? 0 : step);
  world_from_head_ = world_from_head;
  history_.add(now - std::chrono::nanoseconds(std::llround(configuration_.tuning.pointer.of_sample * 1e9)),
               {world_from_head, sway_.way()});
  sampled_ = now;
}

bool Pointer::is_within_reach(const Vector3d& direction) const {
  const PanTilt angles = look_along(base_.world_from_base(ahead_).conjugate() * direction, 0, camera_axis_);
  const auto holds = [this](AxisName name, double angle) {
    const MotionLimits& limits = configuration_.axis(name).limits;
    return angle >= limits.low + limits.margin && angle <= limits.high - limits.margin;
  };
  return holds(AxisName::kPan, angles.pan) && holds(AxisName::kTilt, angles.tilt);
}

/// [s] that the axes take from where the camera looks to there.
double Pointer::time_to(const Vector3d& direction) const {
  const Eigen::Quaterniond base_from_world = base_.world_from_base(ahead_).conjugate();
  const PanTilt from = look_along(base_from_world * view(), 0, camera_axis_);
  const PanTilt to = look_along(base_from_world * direction, 0, camera_axis_);
  const auto time = [this](AxisName name, double way) {
    const MotionLimits& limits = configuration_.axis(name).limits;
    return std::abs(way) / limits.rate + limits.rate / limits.acceleration;
  };
  return std::max(time(AxisName::kPan, to.pan - from.pan), time(AxisName::kTilt, to.tilt - from.tilt));
}

void Pointer::look_at_next() {
  held_ = plan_->next(view(), [this](const Vector3d& to) { return is_within_reach(to); }).value_or(view());
  on_target_for_ = 0;
  sought_for_ = -time_to(held_);
}

/// Begins the mode, and sets what it keeps from its beginning.
void Pointer::begin() {
  begun_ = true;
  on_target_for_ = sought_for_ = 0;
  held_ = view();
  if (const auto* lock = std::get_if<pointing::Lock>(&*pointing_); lock != nullptr && lock->direction)
    held_ = *lock->direction;
  if (const auto* saccade = std::get_if<pointing::Saccade>(&*pointing_)) {
    held_ = saccade->direction
                ? *saccade->direction
                : Vector3d(base_.world_from_base(ahead_) * (base_from_head(saccade->angles) * camera_axis_));
  }
  if (std::holds_alternative<pointing::Fixate>(*pointing_)) track_.forget();
  if (const auto* search = std::get_if<pointing::Search>(&*pointing_)) {
    if (!plan_ || !plan_->is_for(*search) || !searched_ ||
        then_ - *searched_ > configuration_.tuning.pointer.remembered)
      plan_.emplace(*search, view(), configuration_.tuning.search);
    plan_->rank(search->ranked);
    look_at_next();
  }
}

/// The heading of the base goes ahead of what is looked along, no further than the axis can turn.
Pointer::Target Pointer::target_of(const pointing::Follow&, double step) {
  const AxisConfiguration& pan = configuration_.axis(AxisName::kPan);
  const double tilt = configuration_.axis(AxisName::kTilt).neutral;
  const double heading = look_along(base_.world_from_base(ahead_) * optical_axis({pan.neutral, 0})).pan;
  const double room =
      std::min(pan.limits.high - pan.neutral, pan.neutral - pan.limits.low) - pan.limits.margin;
  const double before = look_along(held_).pan;
  const double behind = std::clamp(std::remainder(heading - before, 2 * std::numbers::pi), -room, room);
  const double following = configuration_.tuning.pointer.following;
  const double looked = heading - behind * std::exp(-step / following);
  held_ = optical_axis({looked, tilt});
  return {held_, behind / following * Vector3d::UnitZ().cross(held_)};
}

Pointer::Target Pointer::target_of(const pointing::Fixate&, double) {
  state_.sees_target = track_.is_seen(then_);
  const auto estimate = track_.at(then_);
  if (!estimate || !state_.sees_target) return {held_};
  const Vector3d target = estimate->target - sway_.way() - ahead_ * sway_.rate();
  if (!is_direction(target)) return {held_};
  held_ = target;
  return {held_, estimate->rate - sway_.rate()};
}

Pointer::Target Pointer::target_of(const pointing::Search&, double step) {
  const auto reach = [this](const Vector3d& direction) { return is_within_reach(direction); };
  searched_ = then_;
  sought_for_ += step;
  if (on_target_for_ >= configuration_.tuning.pointer.glance ||
      sought_for_ >= configuration_.tuning.pointer.patience) {
    plan_->look(held_);
    look_at_next();
  }
  state_.looked_at = plan_->looked_at(reach);
  state_.rounds = plan_->rounds();
  return {held_};
}

Pointer::Demands Pointer::towards(const Target& target, double pan) {
  const Eigen::Quaterniond base_from_world = base_.world_from_base(ahead_).conjugate();
  const Vector3d direction = base_from_world * target.direction;
  const PanTilt angles = look_along(direction, pan, camera_axis_);
  const PanTilt rates =
      rates_to_hold(direction, camera_axis_, base_.rate(ahead_), base_from_world * target.moving);
  return {Demand{angles.pan, rates.pan}, Demand{angles.tilt, rates.tilt}};
}

void Pointer::judge(const Vector3d& direction, double step) {
  const PointerOptions& options = configuration_.tuning.pointer;
  const auto* search = std::get_if<pointing::Search>(&*pointing_);
  const double near = search == nullptr
                          ? options.on_target
                          : options.share_of_view * std::min(search->view.pan, search->view.tilt);
  const double off = angle_between(view(), direction);
  on_target_for_ = off < near ? on_target_for_ + step : 0;
  state_.on_target = on_target_for_ >= options.settling;
  state_.out_of_reach = !is_within_reach(direction);
}

std::optional<Pointer::Demands> Pointer::demands(MonotonicTime then, double pan) {
  const double step = std::clamp(std::chrono::duration<double>(then - then_).count(), kSoonest, 0.1);
  then_ = then;
  if (!pointing_) return std::nullopt;
  state_ = {};
  state_.mode = mode_of(*pointing_);
  if (const auto* neutral = std::get_if<pointing::Neutral>(&*pointing_)) {
    if (base_.is_known())
      judge(base_.world_from_base(0) * (base_from_head(neutral->angles) * camera_axis_), step);
    return Demands{Demand{neutral->angles.pan, 0}, Demand{neutral->angles.tilt, 0}};
  }
  if (const auto* jog = std::get_if<pointing::Jog>(&*pointing_))
    return Demands{Demand{std::nullopt, jog->rates.pan}, Demand{std::nullopt, jog->rates.tilt}};
  if (!base_.is_known()) return Demands{};  // it is not known where that is: stay
  const PointerOptions& options = configuration_.tuning.pointer;
  ahead_ = std::min(options.furthest,
                    std::chrono::duration<double>(then - sampled_).count() + options.on_the_wire);
  if (!begun_) begin();
  const Target target = std::visit([&](const auto& mode) { return target_of(mode, step); }, *pointing_);
  judge(target.direction, step);
  return towards(target, pan);
}

std::optional<PointingState> Pointer::state() const {
  return pointing_ ? std::optional(state_) : std::nullopt;
}

}  // namespace cairn
