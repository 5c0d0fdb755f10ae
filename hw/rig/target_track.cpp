// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/target_track.h"

#include <algorithm>

namespace cairn {
namespace {

double seconds(MonotonicTime::duration time) {
  return std::chrono::duration<double>(time).count();
}

}  // namespace

void TargetTrack::see(MonotonicTime when, const Eigen::Vector3d& target) {
  if (seen_ && when <= *seen_) return;
  const double step = seen_ ? seconds(when - *seen_) : options_.forgotten;
  if (step >= options_.forgotten) {
    target_ = target;
    rate_.setZero();
  } else {
    const Eigen::Vector3d expected = target_ + step * rate_;
    const Eigen::Vector3d off = target - expected;
    target_ = expected + step / (step + options_.fold_time / 2) * off;
    rate_ += step / (step + options_.speed_time / 2) * off / (step + options_.fold_time);
  }
  seen_ = when;
}

std::optional<TargetTrack::Estimate> TargetTrack::at(MonotonicTime when) const {
  if (!seen_) return std::nullopt;
  const double passed = std::max(0.0, seconds(when - *seen_));
  if (passed > options_.forgotten)
    return Estimate{target_ + options_.forgotten * rate_, Eigen::Vector3d::Zero()};
  return Estimate{target_ + passed * rate_, rate_};
}

bool TargetTrack::is_seen(MonotonicTime now) const {
  return seen_ && seconds(now - *seen_) < options_.forgotten;
}

}  // namespace cairn
