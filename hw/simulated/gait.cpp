// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/gait.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cairn::simulated {
namespace {

using Eigen::AngleAxisd;
using Eigen::Vector3d;

/// A smooth step from 0 to 1 within a second.
double ramp(double t) {
  const double begun = std::clamp(t, 0.0, 1.0);
  return begun * begun * (3 - 2 * begun);
}

/// The integral of ramp() from 0.
double ramped(double t) {
  const double begun = std::clamp(t, 0.0, 1.0);
  return std::pow(begun, 3) - std::pow(begun, 4) / 2 + std::max(0.0, t - 1);
}

}  // namespace

double Gait::sways() const {
  return 2 * std::numbers::pi * frequency;
}

double Gait::strength(double t) const {
  return ramp(t) * (rest_at ? 1 - ramp(t - *rest_at) : 1);
}

double Gait::heading(double t) const {
  return begin + turn * (ramped(t) - (rest_at ? ramped(t - *rest_at) : 0));
}

Eigen::Quaterniond Gait::world_from_base(double t) const {
  const double sway = strength(t) * std::numbers::pi / 18 * std::sin(sways() * t);
  return Eigen::Quaterniond(AngleAxisd(heading(t) + 0.7 * sway, Vector3d::UnitZ()) *
                            AngleAxisd(sway, Vector3d::UnitY()) * AngleAxisd(0.5 * sway, Vector3d::UnitX()));
}

Vector3d Gait::position(double t) const {
  const double ahead = heading(t);
  return -radius * Vector3d(std::cos(ahead), std::sin(ahead), 0) + steps(t);
}

/// The wearer goes up and down and to and fro twice, and from side to side once, in each sway: at up to 4, 1
/// and 1.5 m/s^2.
Vector3d Gait::steps(double t) const {
  if (frequency == 0) return Vector3d::Zero();
  const double once = -strength(t) / std::pow(sways(), 2);
  const double twice = once / 4;
  return {1.0 * twice * std::sin(2 * sways() * t + 1), 1.5 * once * std::cos(sways() * t),
          4.0 * twice * std::sin(2 * sways() * t)};
}

}  // namespace cairn::simulated
