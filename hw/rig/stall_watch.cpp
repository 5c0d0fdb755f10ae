// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/stall_watch.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kWindow = 0.1;             // [s]
constexpr double kTold = 0.5 * kDegree;     // setpoints that go less far in the window tell nothing: backlash
constexpr double kStill = 0.3;              // of the way of the setpoints: an axis that goes less far stands
constexpr double kStillFor = 0.04;          // [s]: what a start takes until the axis follows,
constexpr double kStillPeriods = 3;         // and until it has been told and measured
constexpr double kFarBehind = 4 * kDegree;  // an axis so far off that comes no nearer is held
constexpr double kBehindFor = 0.1;          // [s]

}  // namespace

bool StallWatch::is_stuck(double setpoint, double measured) {
  recent_.push_back({setpoint, measured});
  if (static_cast<double>(recent_.size() - 1) * period_ > kWindow) recent_.pop_front();
  const double way = setpoint - recent_.front().setpoint;
  const double gone = measured - recent_.front().measured;
  // Setpoints that turn back are ahead of an axis that does not yet: it went some way, if not theirs.
  const auto [low, high] =
      std::minmax_element(recent_.begin(), recent_.end(),
                          [](const Sample& a, const Sample& b) { return a.measured < b.measured; });
  const bool still = std::abs(way) >= kTold && high->measured - low->measured < kStill * std::abs(way);
  const bool apart = (setpoint - measured) * way > 0;  // one that catches up stands for a while, too
  still_for_ = still && apart ? still_for_ + period_ : 0;
  // After lost setpoints one at its highest rate catches up slowly.
  const double behind = setpoint - measured;
  const bool comes = std::copysign(gone, behind * gone) >= kTold;
  behind_for_ = std::abs(behind) > kFarBehind && !comes ? behind_for_ + period_ : 0;
  return still_for_ >= std::max(kStillFor, kStillPeriods * period_) || behind_for_ >= kBehindFor;
}

}  // namespace cairn
