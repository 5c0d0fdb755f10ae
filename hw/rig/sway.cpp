// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/sway.h"

#include <cmath>

namespace cairn {
namespace {

constexpr double kForgotten = 2;  // [s]: two steps of the wearer

}  // namespace

void Sway::update(const Eigen::Vector3d& acceleration, double step) {
  const double kept = std::exp(-step / kForgotten);
  const Eigen::Vector3d before = rate_;
  rate_ = kept * (rate_ + step * acceleration);
  way_ = kept * (way_ + step * (before + rate_) / 2);
}

}  // namespace cairn
