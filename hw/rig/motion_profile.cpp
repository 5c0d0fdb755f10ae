// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/motion_profile.h"

#include <algorithm>
#include <cmath>

namespace cairn {

MotionProfile::MotionProfile(const MotionLimits& limits, double period, double position)
    : limits_(limits), period_(period), position_(position) {}

/// The highest rate of the next period from which steps of the full acceleration end exactly `distance`
/// ahead, the last of them a smaller one.
double MotionProfile::stopping_rate(double distance) const {
  if (distance <= 0) return 0;
  const double step = limits_.acceleration * period_;  // of rate
  const double unit = step * period_;
  const double steps = std::ceil((std::sqrt(1 + 8 * distance / unit) - 1) / 2);
  if (steps <= 1) return distance / period_;
  return distance / period_ / steps + step * (steps - 1) / 2;
}

/// The rate at which an axis that is let go comes to rest `distance` ahead.
double MotionProfile::coasting_rate(double distance) const {
  if (distance <= 0) return 0;
  const double slowing = std::min(limits_.coasting, limits_.acceleration);
  const double reaction = limits_.reaction + period_;
  return slowing * (std::sqrt(reaction * reaction + 2 * distance / slowing) - reaction);
}

double MotionProfile::highest_rate(double to_soft_limit) const {
  return std::min(
      {limits_.rate, stopping_rate(to_soft_limit), coasting_rate(to_soft_limit + limits_.margin)});
}

void MotionProfile::advance(const Demand& demand) {
  const double low = limits_.low + limits_.margin;
  const double high = limits_.high - limits_.margin;
  double wanted = demand.rate;
  if (demand.position) {
    const double target = std::clamp(*demand.position, low, high);
    if (target != *demand.position) wanted = 0;  // the limit does not move on
    const double ahead = target - position_;
    wanted += std::copysign(stopping_rate(std::abs(ahead)), ahead);
  }
  const double step = limits_.acceleration * period_;
  const double before = rate_;
  // The limits last: from a rate that they allow they are kept within the acceleration.
  rate_ = std::clamp(std::clamp(wanted, rate_ - step, rate_ + step), -highest_rate(position_ - low),
                     highest_rate(high - position_));
  position_ += rate_ * period_;
  acceleration_ = (rate_ - before) / period_;
}

Setpoint MotionProfile::for_axis_at(double measured) const {
  const double up = coasting_rate(limits_.high - measured);
  const double down = coasting_rate(measured - limits_.low);
  const double rate = std::clamp(rate_ + acceleration_ * limits_.lag, -std::min(down, limits_.rate),
                                 std::min(up, limits_.rate));
  const double ahead = measured + rate * period_;  // until the next setpoint
  return {
      std::clamp(position_, ahead - (down + rate) * limits_.reaction, ahead + (up - rate) * limits_.reaction),
      rate};
}

}  // namespace cairn
