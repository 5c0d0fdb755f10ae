// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/backlash.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kNoise = 0.035;  // [rad/s] of a demand
// [s] over which a crossing of the play is taken for a turn of the base, which it never was: gyro and encoder
// tell of it at different times. A slower turn would be answered by the next crossing, for ever.
constexpr double kCrossing = 0.05;

}  // namespace

Backlash::Backlash(double play) : half_(play / 2), turning_(std::max(kNoise, play / kCrossing)) {}

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
