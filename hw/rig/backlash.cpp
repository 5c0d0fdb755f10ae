// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/backlash.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kTurning = 0.035;  // [rad/s]: above the noise of a demand

}  // namespace

double Backlash::follow(double motor) {
  axis_ = known_ ? std::clamp(axis_, motor - half_, motor + half_) : motor;
  known_ = true;
  return axis_;
}

double Backlash::motor_for(double axis, double rate) {
  if (std::abs(rate) > kTurning) side_ = std::copysign(1, rate);
  return axis + side_ * half_;
}

}  // namespace cairn
