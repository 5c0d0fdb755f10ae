// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/backlash.h"

#include <algorithm>
#include <cmath>

namespace cairn {

Backlash::Backlash(double play, const BacklashOptions& options)
    : half_(play / 2), turning_(std::max(options.noise, play / options.crossing)) {}

double Backlash::follow(double motor) {
  axis_ = known_ ? std::clamp(axis_, motor - half_, motor + half_) : motor;
  known_ = true;
  return axis_;
}

double Backlash::motor_for(double axis, double rate) {
  if (std::abs(rate) > turning_) side_ = std::copysign(1, rate);
  return axis + side_ * half_;
}

}  // namespace cairn
