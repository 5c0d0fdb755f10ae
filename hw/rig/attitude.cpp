// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/attitude.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kGravity = 9.80665;    // [m/s^2]
constexpr double kTrusted = 0.2;        // further from gravity, an acceleration does not tell where up is
constexpr double kUprighting = 0.3;     // [1/s]: slow beside a step of the wearer
constexpr double kBiasLearning = 0.02;  // [1/s^2]

}  // namespace

void Attitude::update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step) {
  const double strength = acceleration.norm();
  const bool trusted = std::abs(strength / kGravity - 1) < kTrusted;
  if (!known_) {
    if (!trusted) return;
    world_from_base_ = Eigen::Quaterniond::FromTwoVectors(acceleration, Eigen::Vector3d::UnitZ());
    const double heading = std::atan2((world_from_base_ * Eigen::Vector3d::UnitX()).y(),
                                      (world_from_base_ * Eigen::Vector3d::UnitX()).x());
    world_from_base_ = Eigen::AngleAxisd(-heading, Eigen::Vector3d::UnitZ()) * world_from_base_;
    rate_ = rate;
    known_ = true;
    return;
  }
  Eigen::Vector3d correction = Eigen::Vector3d::Zero();
  if (trusted) {
    const Eigen::Vector3d up = world_from_base_.conjugate() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d wrong = (acceleration / strength).cross(up);
    bias_ -= kBiasLearning * step * wrong;
    correction = kUprighting * wrong;
  }
  rate_ = rate - bias_;
  const Eigen::Vector3d turn = (rate_ + correction) * step;
  const double angle = turn.norm();
  if (angle > 0) world_from_base_ = world_from_base_ * Eigen::AngleAxisd(angle, turn / angle);
  world_from_base_.normalize();
}

}  // namespace cairn
