// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/sway.h"

#include <cmath>

namespace cairn {

void Sway::update(const Eigen::Vector3d& acceleration, double step) {
  const double kept = std::exp(-step / forgotten_);
  const Eigen::Vector3d before = rate_;
  rate_ = kept * (rate_ + step * acceleration);
  way_ = kept * (way_ + step * (before + rate_) / 2);
}

}  // namespace cairn
