// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/gyro_bias.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

constexpr double kImageSigma = 1e-3;  // [rad] of the turn between two tracked frames: half a pixel
constexpr double kDrift = 3e-4;       // [rad/s per square root of a second]: warming up, small devices
constexpr double kGate = 4;           // [sigma] what is farther off is a frame tracked wrongly
constexpr double kForget = 0.05;      // of the means, a frame
constexpr double kUnexplained = 1.0 / 3;
constexpr double kNoTurn = 4 * kImageSigma;  // what is left is noise

}  // namespace

void GyroBias::learn(const Eigen::Quaterniond& seen, const Eigen::Quaterniond& measured, double seconds) {
  const Eigen::Vector3d left = so3_log(seen * measured.conjugate());
  turned_ += kForget * (so3_log(seen).norm() - turned_);
  left_ += kForget * (left.norm() - left_);
  if (leaves_turns_unexplained()) return;
  const double predicted = sigma_ * sigma_ + kDrift * kDrift * seconds;
  const double noise = kImageSigma * kImageSigma / (seconds * seconds);
  sigma_ = std::sqrt(predicted);
  if (left.norm() > kGate * std::sqrt(predicted + noise) * seconds) return;
  const double gain = predicted / (predicted + noise);
  value_ += gain * left / seconds;
  sigma_ = std::sqrt((1 - gain) * predicted);
}

bool GyroBias::leaves_turns_unexplained() const {
  return left_ > std::max(kNoTurn, kUnexplained * turned_);
}

}  // namespace cairn
