// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/target_track.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr double kForgotten = 0.5;   // [s]: after a longer gap the speed is another one
constexpr double kFoldTime = 0.04;   // [s] over which sightings are averaged
constexpr double kSpeedTime = 0.15;  // [s] likewise for the speed, below a step of the wearer

double seconds(MonotonicTime::duration time) {
  return std::chrono::duration<double>(time).count();
}

}  // namespace

void TargetTrack::see(MonotonicTime when, const Eigen::Vector3d& target) {
  if (seen_ && when <= *seen_) return;
  const double step = seen_ ? seconds(when - *seen_) : kForgotten;
  if (step >= kForgotten) {
    target_ = target;
    rate_.setZero();
  } else {
    const Eigen::Vector3d expected = target_ + step * rate_;
    const Eigen::Vector3d off = target - expected;
    target_ = expected + step / (step + kFoldTime / 2) * off;
    rate_ += step / (step + kSpeedTime / 2) * off / (step + kFoldTime);
  }
  seen_ = when;
}

std::optional<TargetTrack::Estimate> TargetTrack::at(MonotonicTime when) const {
  if (!seen_) return std::nullopt;
  const double passed = std::max(0.0, seconds(when - *seen_));
  if (passed > kForgotten) return Estimate{target_ + kForgotten * rate_, Eigen::Vector3d::Zero()};
  return Estimate{target_ + passed * rate_, rate_};
}

bool TargetTrack::is_seen(MonotonicTime now) const {
  return seen_ && seconds(now - *seen_) < kForgotten;
}

}  // namespace cairn
