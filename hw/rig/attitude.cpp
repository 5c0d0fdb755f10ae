// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/attitude.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kGravity = 9.80665;  // [m/s^2]

}  // namespace

Eigen::Vector3d Attitude::off_upright(const Eigen::Vector3d& acceleration) const {
  return (acceleration / kGravity).cross(world_from_imu_.conjugate() * Eigen::Vector3d::UnitZ());
}

void Attitude::turn_by(const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  if (angle > 0) world_from_imu_ = world_from_imu_ * Eigen::AngleAxisd(angle, turn / angle);
  world_from_imu_.normalize();
}

Attitude::Line Attitude::line_through(const Second& second) {
  const double n = second.samples;
  const double spread = second.times_squared - second.times * second.times / n;
  const Eigen::Vector3d slope = (second.times_turns - second.times * second.turns / n) / spread;
  const Eigen::Vector3d left =
      second.turns_squared - second.turns.cwiseAbs2() / n - spread * slope.cwiseAbs2();
  return {slope, std::sqrt(std::max(0.0, left.maxCoeff()) / n)};
}

/// Learns the gyro's bias, and where up is, from each second of rest. At rest a shoulder turns by that bias
/// alone, so evenly. The play of the gears makes the head tremble against it, which is neither rest nor bias
/// of the head, and averages out of a line through a second.
void Attitude::learn_at_rest(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
                             const Eigen::Vector3d& turned) {
  second_.time += step;
  ++second_.samples;
  second_.rate += rate;
  second_.acceleration += acceleration;
  second_.turn += step * rate - turned;
  second_.times += second_.time;
  second_.times_squared += second_.time * second_.time;
  second_.turns += second_.turn;
  second_.turns_squared += second_.turn.cwiseAbs2();
  second_.times_turns += second_.time * second_.turn;
  if (second_.time < options_.rest) return;
  const Line line = line_through(second_);
  const bool head_turns_slowly = second_.rate.norm() / second_.samples < options_.highest_bias;
  if (head_turns_slowly && line.off < options_.rest_off && line.slope.norm() < options_.highest_bias) {
    rests_ = std::min(rests_ + 1, options_.most_rests);
    bias_ += (line.slope - bias_) / rests_;
    turn_by(off_upright(second_.acceleration / second_.samples));
  }
  second_ = {};
}

void Attitude::update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
                      const Eigen::Vector3d& turned) {
  if (!known_) {
    if (std::abs(acceleration.norm() / kGravity - 1) > options_.trusted) return;
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
  bias_ -= options_.bias_learning * step * wrong;
  learn_at_rest(rate, acceleration, step, turned);
  rate_ = rate - bias_;
  turn_by((rate_ + std::max(options_.uprighting, 1 / (age_ + options_.first)) * wrong) * step);
}

}  // namespace cairn
