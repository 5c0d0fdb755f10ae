// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

/// How the base stands in the world, from its gyro and, slowly, from where its accelerometer finds up. The
/// gyro's bias is learnt: all of it in each second of rest, and else but for the part about the vertical, by
/// which the heading drifts. A slow and even turn, below 1.7 deg/s, cannot be told from a bias. Pure.
class Attitude {
 public:
  /// One sample: rate of turn [rad/s] and acceleration [m/s^2, up at rest] in the base's axes, `step` [s]
  /// after the one before. The first one sets up, with heading 0.
  void update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step);

  /// The world (z up) from the base.
  [[nodiscard]] const Eigen::Quaterniond& world_from_base() const { return world_from_base_; }
  /// Of the newest sample, without bias, in the base's axes [rad/s].
  [[nodiscard]] const Eigen::Vector3d& rate() const { return rate_; }
  [[nodiscard]] const Eigen::Vector3d& bias() const { return bias_; }
  [[nodiscard]] bool is_known() const { return known_; }

 private:
  /// What the gyro has shown since a second ago or less.
  struct Second {
    double time = 0;  ///< [s]
    int samples = 0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::Vector3d least = Eigen::Vector3d::Zero();
    Eigen::Vector3d most = Eigen::Vector3d::Zero();
  };
  void learn_at_rest(const Eigen::Vector3d& rate, double step);

  Second second_;
  int rests_ = 0;
  bool known_ = false;
  Eigen::Quaterniond world_from_base_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero();
};

}  // namespace cairn
