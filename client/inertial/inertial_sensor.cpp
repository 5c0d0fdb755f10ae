// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/inertial_sensor.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/se3.h"

namespace cairn {
InertialSensor::InertialSensor(const ImuMount& mount, const InertialSensorOptions& options)
    : options_(options), mount_(mount), bias_(options.bias), up_(options.up) {}

void InertialSensor::use(const ImuMount& mount) {
  if (mount.camera_from_imu.coeffs() != mount_.camera_from_imu.coeffs())
    *this = InertialSensor(mount, options_);
  for (Rate& rate : rates_) rate.time = rate.time + (mount.clock_offset - mount_.clock_offset);
  mount_ = mount;
}

void InertialSensor::add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    const Timestamp time = sample.time + mount_.clock_offset;
    const bool is_first = rates_.empty();
    double step = is_first ? 0 : seconds_between(time, rates_.back().time);
    if (step < -options_.jump) rates_.clear();
    if (step < -options_.jump || step > options_.most_gap) {
      up_.reset();
      step = 0;
    } else if (!is_first && step <= 0) {
      continue;
    }
    const Rate rate{time, mount_.camera_from_imu * sample.rate};
    const Eigen::Vector3d mean = step > 0 ? Eigen::Vector3d((rates_.back().rate + rate.rate) / 2) : rate.rate;
    up_.update(mean - bias(), mount_.camera_from_imu * sample.acceleration, step, bias_.sigma());
    rates_.push_back(rate);
  }
  if (rates_.empty()) return;
  // Half of it at a time, so that it is moved seldom.
  const auto is_kept = [&](double seconds) {
    return std::find_if(rates_.begin(), rates_.end(), [&](const Rate& rate) {
      return seconds_between(rates_.back().time, rate.time) <= seconds;
    });
  };
  if (seconds_between(rates_.back().time, rates_.front().time) > 2 * options_.kept)
    rates_.erase(rates_.begin(), is_kept(options_.kept));
}

/// The last sample at or before a moment.
std::optional<size_t> InertialSensor::first_needed(Timestamp from) const {
  const auto after = std::upper_bound(rates_.begin(), rates_.end(), from,
                                      [](Timestamp time, const Rate& rate) { return time < rate.time; });
  if (after == rates_.begin()) return std::nullopt;
  return static_cast<size_t>(after - rates_.begin()) - 1;
}

std::optional<CameraTurn> InertialSensor::turn(Timestamp from, Timestamp to) const {
  const auto first = first_needed(from);
  if (!first || to < from) return std::nullopt;
  const double seconds = seconds_between(to, from);
  CameraTurn turn;
  double ahead = 0;
  double drawn = 0;  // variance [rad^2] of what the turn between two samples is off by
  Timestamp at = from;
  for (size_t i = *first; at < to; ++i) {
    const Rate& before = rates_[i];
    Eigen::Vector3d rate = before.rate;
    Timestamp until = to;
    if (i + 1 < rates_.size()) {
      const Rate& after = rates_[i + 1];
      const double gap = seconds_between(after.time, before.time);
      if (gap > options_.most_gap) return std::nullopt;
      until = std::min(to, after.time);
      const double off = options_.turn_jerk * gap * gap * gap / 12;  // as trapezoids are
      drawn += off * off;
      // Of the middle of the part that is needed.
      const double part =
          (seconds_between(at, before.time) + seconds_between(until, before.time)) / (2 * gap);
      rate += part * (after.rate - before.rate);
    } else {
      ahead = seconds_between(to, before.time);
      if (ahead > options_.most_ahead) return std::nullopt;
    }
    const Eigen::Vector3d angle = (rate - bias()) * seconds_between(until, at);
    turn.now_from_before = so3_exp(-angle) * turn.now_from_before;
    at = until;
  }
  const double by_bias = bias_.sigma() * seconds;
  const double guessed = options_.turn_acceleration * ahead * ahead / 2;
  turn.sigma =
      std::sqrt(options_.noise * options_.noise * seconds + by_bias * by_bias + guessed * guessed + drawn);
  return turn;
}

std::optional<UpDirection> InertialSensor::up(Timestamp time) const {
  auto newest = up_.up();
  if (!newest) return std::nullopt;
  const Timestamp last = rates_.back().time;
  const auto between = turn(std::min(time, last), std::max(time, last));
  if (!between) return std::nullopt;
  const Eigen::Quaterniond& later = between->now_from_before;
  newest->up = time < last ? later.conjugate() * newest->up : later * newest->up;
  newest->sigma = std::hypot(newest->sigma, between->sigma);
  return newest;
}

void InertialSensor::tracked(Timestamp from, Timestamp to, const Eigen::Quaterniond& now_from_before) {
  const double seconds = seconds_between(to, from);
  if (seconds <= 0) return;
  if (const auto measured = turn(from, to)) bias_.learn(now_from_before, measured->now_from_before, seconds);
}

}  // namespace cairn
