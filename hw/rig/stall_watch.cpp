// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/stall_watch.h"

#include <algorithm>
#include <cmath>

namespace cairn {

bool StallWatch::is_stuck(double setpoint, double measured) {
  recent_.push_back({setpoint, measured});
  if (static_cast<double>(recent_.size() - 1) * period_ > options_.window) recent_.pop_front();
  const double way = setpoint - recent_.front().setpoint;
  const double gone = measured - recent_.front().measured;
  // Setpoints that turn back are ahead of an axis that does not yet: it went some way, if not theirs.
  const auto [low, high] =
      std::minmax_element(recent_.begin(), recent_.end(),
                          [](const Sample& a, const Sample& b) { return a.measured < b.measured; });
  const bool still =
      std::abs(way) >= options_.told && high->measured - low->measured < options_.still * std::abs(way);
  const bool apart = (setpoint - measured) * way > 0;  // one that catches up stands for a while, too
  still_for_ = still && apart ? still_for_ + period_ : 0;
  // After lost setpoints one at its highest rate catches up slowly.
  const double behind = setpoint - measured;
  const bool comes = std::copysign(gone, behind * gone) >= options_.told;
  behind_for_ = std::abs(behind) > options_.far_behind && !comes ? behind_for_ + period_ : 0;
  return still_for_ >= std::max(options_.still_for, options_.still_periods * period_) ||
         behind_for_ >= options_.behind_for;
}

}  // namespace cairn
