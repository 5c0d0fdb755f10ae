// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hw/rig/rig_tuning.h"

namespace cairn {

/// The play of a gear: where the axis stands behind a motor that the encoder measures, and where the motor
/// must go for an axis to follow. All angles are of the axis [rad]. Pure.
class Backlash {
 public:
  /// `play`: how far the motor turns from one flank of the teeth to the other.
  Backlash(double play, const BacklashOptions& options);

  /// The motor stands at `motor`: gives where the axis is. One that nothing pushes stays where it is.
  double follow(double motor);
  /// The motor's angle [rad of the axis] for the axis to stand at `axis` while it turns at `rate` [rad/s]. A
  /// turn so slow that the play itself could have made it does not change the flank.
  [[nodiscard]] double motor_for(double axis, double rate);

 private:
  double half_;
  double turning_;  ///< [rad/s]
  double axis_ = 0;
  bool known_ = false;
  double side_ = 0;  ///< +1: the motor pushes the axis upward
};

}  // namespace cairn
