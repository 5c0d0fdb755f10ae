// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/wearer.h"

#include <algorithm>
#include <cmath>

namespace cairn::simulated {
namespace {

constexpr double kGravity = 9.80665;  // [m/s^2]
constexpr double kToRest = 1;         // [s], as Gait does
constexpr double kKept = 2;           // [s] that what was is still asked for

double minimum_jerk(double part) {
  const double p = std::clamp(part, 0.0, 1.0);
  return p * p * p * (10 - 15 * p + 6 * p * p);
}

}  // namespace

void Wearer::stand(double now) {
  Leg& last = legs_.back();
  if (last.gait.frequency == 0 || last.gait.rest_at) return;
  last.gait.rest_at = std::max(1.0, now - last.begin);
}

std::optional<double> Wearer::rests_at() const {
  const Leg& last = legs_.back();
  if (last.gait.frequency == 0) return last.begin;
  if (!last.gait.rest_at) return std::nullopt;
  return last.begin + *last.gait.rest_at + kToRest;
}

void Wearer::walk(double frequency, double turn, double now) {
  forget(now);
  stand(now);
  const double begin = std::max(now, *rests_at());
  const Leg& last = legs_.back();
  const Gait gait{.frequency = frequency,
                  .turn = turn,
                  .radius = last.gait.radius,
                  .begin = last.gait.heading(begin - last.begin)};
  legs_.push_back({begin, gait});
}

void Wearer::turn(double angle, double time, double now) {
  forget(now);
  turns_.push_back({now, time, angle});
}

void Wearer::forget(double now) {
  while (legs_.size() > 1 && legs_[1].begin < now - kKept) legs_.pop_front();
  while (!turns_.empty() && turns_.front().begin + turns_.front().time < now - kKept) {
    turned_before_ += turns_.front().angle;
    turns_.pop_front();
  }
}

const Wearer::Leg& Wearer::leg_at(double t) const {
  const auto next =
      std::find_if(legs_.begin() + 1, legs_.end(), [&](const Leg& leg) { return leg.begin > t; });
  return *(next - 1);
}

double Wearer::turned(double t) const {
  double turned = turned_before_;
  for (const Turn& turn : turns_) turned += turn.angle * minimum_jerk((t - turn.begin) / turn.time);
  return turned;
}

/// Turned aside about the vertical, whatever the sway.
Eigen::Quaterniond Wearer::world_from_base(double t) const {
  const Leg& leg = leg_at(t);
  return Eigen::AngleAxisd(turned(t), Eigen::Vector3d::UnitZ()) * leg.gait.world_from_base(t - leg.begin);
}

Eigen::Vector3d Wearer::position(double t) const {
  const Leg& leg = leg_at(t);
  return leg.gait.position(t - leg.begin);
}

Eigen::Vector3d Wearer::rate(double t) const {
  return rate_of([this](double at) { return world_from_base(at); }, t);
}

Eigen::Vector3d Wearer::acceleration(double t) const {
  return world_from_base(t).conjugate() * (acceleration_of([this](double at) { return position(at); }, t) +
                                           kGravity * Eigen::Vector3d::UnitZ());
}

}  // namespace cairn::simulated
