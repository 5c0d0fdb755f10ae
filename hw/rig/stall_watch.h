// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>

#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Tells from setpoints and measured angles, one of each a period, whether an axis is stuck. Pure.
class StallWatch {
 public:
  StallWatch(double period, const StallOptions& options) : period_(period), options_(options) {}
  /// Whether it is stuck as of this period. Angles in [rad].
  [[nodiscard]] bool is_stuck(double setpoint, double measured);

 private:
  struct Sample {
    double setpoint;
    double measured;
  };
  double period_;
  StallOptions options_;
  std::deque<Sample> recent_;
  double still_for_ = 0;   ///< [s]
  double behind_for_ = 0;  ///< [s]
};

}  // namespace cairn
