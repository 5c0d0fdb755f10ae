// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/gyro_prior.h"

#include <utility>

namespace cairn {
void GyroPrior::use(const std::optional<ImuMount>& mount) {
  if (!mount) {
    sensor_.reset();
  } else if (sensor_) {
    sensor_->use(*mount);
  } else {
    sensor_.emplace(*mount, options_.sensor);
  }
}

void GyroPrior::next_frame(Timestamp time) {
  before_ = now_;
  now_ = time;
  turn_.reset();
  was_sharp_ = std::exchange(is_sharp_, false);
  turn_sigma_.reset();
  if (!before_) return;
  const auto turn = sensor_ ? sensor_->turn(*before_, time) : std::nullopt;
  is_missing_ = !turn;
  if (!turn) {
    if (const auto by_encoders = encoders_.turn(*before_, time))
      turn_ = SE3(*by_encoders, Eigen::Vector3d::Zero());
    return;
  }
  if (sensor_->contradicts_images()) return;
  turn_ = SE3(turn->now_from_before, Eigen::Vector3d::Zero());
  turn_sigma_ = turn->sigma;
}

ImuUse GyroPrior::use() const {
  if (!sensor_) return ImuUse::kNone;
  if (is_missing_) return ImuUse::kMissing;
  return sensor_->contradicts_images() ? ImuUse::kContradicts : ImuUse::kUsed;
}

std::optional<UpDirection> GyroPrior::up() const {
  if (!sensor_ || !now_ || sensor_->contradicts_images()) return std::nullopt;
  return sensor_->up(*now_);
}

void GyroPrior::tracked(const SE3& now_from_before) {
  is_sharp_ = true;
  if (sensor_ && was_sharp_) sensor_->tracked(*before_, *now_, now_from_before.rotation());
}

bool GyroPrior::carries(double reach) {
  if (!turn_ || !turn_sigma_) return false;
  blind_sigma_ += *turn_sigma_;  // most of it is the bias, which is the same in all
  return options_.sigmas * blind_sigma_ <= reach;
}

}  // namespace cairn
