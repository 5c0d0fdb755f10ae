// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/gyro_bias.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/se3.h"

namespace cairn {
void GyroBias::learn(const Eigen::Quaterniond& seen, const Eigen::Quaterniond& measured, double seconds) {
  const Eigen::Vector3d left = so3_log(seen * measured.conjugate());
  turned_ += options_.forget * (so3_log(seen).norm() - turned_);
  left_ += options_.forget * (left.norm() - left_);
  if (leaves_turns_unexplained()) return;
  const double predicted = sigma_ * sigma_ + options_.drift * options_.drift * seconds;
  const double noise = options_.image_sigma * options_.image_sigma / (seconds * seconds);
  sigma_ = std::sqrt(predicted);
  if (left.norm() > options_.gate * std::sqrt(predicted + noise) * seconds) return;
  const double gain = predicted / (predicted + noise);
  value_ += gain * left / seconds;
  sigma_ = std::sqrt((1 - gain) * predicted);
}

bool GyroBias::leaves_turns_unexplained() const {
  return left_ > std::max(options_.no_turn * options_.image_sigma, options_.unexplained * turned_);
}

}  // namespace cairn
