// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/base_motion.h"

#include <cmath>

namespace cairn {

void BaseMotion::update(const Eigen::Quaterniond& world_from_head, const PanTilt& angles, double step) {
  const Eigen::Quaterniond before = world_from_base_;
  world_from_base_ = world_from_head * base_from_head(angles).conjugate();
  if (!known_ || step <= 0) {
    mean_ = rate_ = acceleration_ = Eigen::Vector3d::Zero();
    known_ = true;
    return;
  }
  // Half a step ago, the base turned at the mean rate.
  const Eigen::AngleAxisd turn(before.conjugate() * world_from_base_);
  const Eigen::Vector3d mean = turn.angle() / step * turn.axis();
  const double share = 1 - std::exp(-step / smoothing_);
  acceleration_ += share * ((mean - mean_) / step - acceleration_);
  mean_ = mean;
  rate_ = mean + step / 2 * acceleration_;
}

Eigen::Quaterniond BaseMotion::world_from_base(double ahead) const {
  const Eigen::Vector3d turn = ahead * rate_ + ahead * ahead / 2 * acceleration_;
  const double angle = turn.norm();
  if (angle == 0) return world_from_base_;
  return world_from_base_ * Eigen::AngleAxisd(angle, turn / angle);
}

}  // namespace cairn
