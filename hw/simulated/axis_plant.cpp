// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/axis_plant.h"

#include <algorithm>
#include <cmath>

namespace cairn::simulated {

AxisPlant::AxisPlant(const PlantOptions& options) : options_(options), angle_(options.start) {}

double AxisPlant::shaft_at(double angle) const {
  return (angle - options_.start) * options_.turns_per_radian;
}

void AxisPlant::advance(double current, double step) {
  shaft_rate_ = (shaft_rate_ + current * options_.acceleration * step) / (1 + options_.damping * step);
  const double slowed = std::max(0.0, std::abs(shaft_rate_) - options_.friction * step);
  shaft_rate_ = std::copysign(slowed, shaft_rate_);
  shaft_ += shaft_rate_ * step;

  const double play = options_.backlash / 2;
  const double lowest = shaft_at((blocked_ ? angle_ : options_.low_stop) - play);
  const double highest = shaft_at((blocked_ ? angle_ : options_.high_stop) + play);
  if (shaft_ < lowest || shaft_ > highest) {
    shaft_ = std::clamp(shaft_, lowest, highest);
    shaft_rate_ = 0;
    touched_stop_ = touched_stop_ || !blocked_;
  }
  const double driven = options_.start + shaft_ / options_.turns_per_radian;
  const double before = angle_;
  if (!blocked_) angle_ = std::clamp(angle_, driven - play, driven + play);
  rate_ = (angle_ - before) / step;
}

}  // namespace cairn::simulated
