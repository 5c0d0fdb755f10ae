// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/up_filter.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

constexpr double kGravity = 9.80665;  // [m/s^2]

}  // namespace

void UpFilter::update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
                      double rate_sigma) {
  const double length = acceleration.norm();
  // The part along gravity shows in the length; the parts across, which tilt it, are as large.
  const double excess = length / kGravity - 1;
  if (age_ == 0 && up_.isZero()) {
    if (length <= 0) return;
    up_ = acceleration / length;
    shaken_ = std::max(excess * excess, 0.1 * 0.1);  // not known yet
    variance_ = shaken_ + options_.accelerometer_sigma * options_.accelerometer_sigma;
    return;
  }
  age_ += step;
  up_ = so3_exp(-rate * step) * up_;
  variance_ += rate_sigma * rate_sigma * step * std::max(step, options_.late);
  shaken_ += std::min(1.0, step / std::min(options_.late, age_)) * (excess * excess - shaken_);
  if (length <= 0) return;
  const double noise = (shaken_ + options_.accelerometer_sigma * options_.accelerometer_sigma) *
                       std::max(1.0, options_.shaken_for / std::max(step, 1e-6));
  const double gain = variance_ / (variance_ + noise);
  // Over g, not over its length: of steps that bounce and surge together, directions have a mean that leans.
  const Eigen::Vector3d towards = up_.cross(acceleration / std::max(kGravity, length / 2));
  up_ = (so3_exp(gain * towards) * up_).normalized();
  // What the accelerometer has of a bias does not average out.
  variance_ = std::max((1 - gain) * variance_, options_.accelerometer_sigma * options_.accelerometer_sigma);
}

std::optional<UpDirection> UpFilter::up() const {
  const double sigma = std::sqrt(variance_);
  if (up_.isZero() || sigma > options_.most_sigma) return std::nullopt;
  return UpDirection{up_, sigma};
}

}  // namespace cairn
