// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/attitude.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kGravity = 9.80665;      // [m/s^2]
constexpr double kTrusted = 0.2;          // further from gravity, one acceleration does not tell where up is
constexpr double kUprighting = 0.15;      // [1/s]: slow beside a step of the wearer
constexpr double kBiasLearning = 0.0056;  // [1/s^2]: a quarter of its square, so that nothing swings

constexpr double kFirst = 0.5;  // [s]: at first it is the mean of all accelerations

constexpr double kRest = 1;            // [s]
constexpr double kRestSpread = 0.04;   // [rad/s]: noise stays within it, a wearer does not
constexpr double kHighestBias = 0.03;  // [rad/s]
constexpr int kMostRests = 20;         // that are averaged

}  // namespace

Eigen::Vector3d Attitude::off_upright(const Eigen::Vector3d& acceleration) const {
  return (acceleration / kGravity).cross(world_from_imu_.conjugate() * Eigen::Vector3d::UnitZ());
}

void Attitude::turn_by(const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  if (angle > 0) world_from_imu_ = world_from_imu_ * Eigen::AngleAxisd(angle, turn / angle);
  world_from_imu_.normalize();
}

void Attitude::learn_at_rest(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step) {
  second_.least = second_.samples == 0 ? rate : second_.least.cwiseMin(rate);
  second_.most = second_.samples == 0 ? rate : second_.most.cwiseMax(rate);
  second_.sum += rate;
  second_.acceleration += acceleration;
  second_.time += step;
  ++second_.samples;
  if (second_.time < kRest) return;
  const Eigen::Vector3d mean = second_.sum / second_.samples;
  if ((second_.most - second_.least).maxCoeff() < kRestSpread && mean.norm() < kHighestBias) {
    rests_ = std::min(rests_ + 1, kMostRests);
    bias_ += (mean - bias_) / rests_;
    turn_by(off_upright(second_.acceleration / second_.samples));
  }
  second_ = {};
}

void Attitude::update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step) {
  if (!known_) {
    if (std::abs(acceleration.norm() / kGravity - 1) > kTrusted) return;
    world_from_imu_ = Eigen::Quaterniond::FromTwoVectors(acceleration, Eigen::Vector3d::UnitZ());
    const double heading = std::atan2((world_from_imu_ * Eigen::Vector3d::UnitX()).y(),
                                      (world_from_imu_ * Eigen::Vector3d::UnitX()).x());
    world_from_imu_ = Eigen::AngleAxisd(-heading, Eigen::Vector3d::UnitZ()) * world_from_imu_;
    rate_ = rate;
    known_ = true;
    return;
  }
  // All of a step of the wearer counts, as it is: what is left out or made shorter of it is missing in the
  // mean.
  const Eigen::Vector3d wrong = off_upright(acceleration);
  age_ += step;
  bias_ -= kBiasLearning * step * wrong;
  learn_at_rest(rate, acceleration, step);
  rate_ = rate - bias_;
  turn_by((rate_ + std::max(kUprighting, 1 / (age_ + kFirst)) * wrong) * step);
}

}  // namespace cairn
