// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "hw/rig/kinematics.h"
#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Estimates how the base moves under the head: what the IMU on the head measures, less what the encoders say
/// that the axes do. Where the gear's backlash keeps the axis from following the motor, the base seems to
/// have turned instead; what is demanded of the motor then makes up for it, and so for the backlash. Pure.
class BaseMotion {
 public:
  explicit BaseMotion(const BaseOptions& options) : smoothing_(options.smoothing) {}

  /// Takes one sample: the head's attitude, and where the encoders have the axes at that time, `step` [s]
  /// after the sample before; 0: nobody knows how long.
  void update(const Eigen::Quaterniond& world_from_head, const PanTilt& angles, double step);

  [[nodiscard]] bool is_known() const { return known_; }
  /// The base's predicted attitude `ahead` [s] after the newest sample.
  [[nodiscard]] Eigen::Quaterniond world_from_base(double ahead) const;
  /// The base's predicted rate of turn then [rad/s, in its own axes].
  [[nodiscard]] Eigen::Vector3d rate(double ahead) const { return rate_ + ahead * acceleration_; }

 private:
  double smoothing_;  ///< [s]
  bool known_ = false;
  Eigen::Quaterniond world_from_base_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d mean_ = Eigen::Vector3d::Zero();  ///< rate since the sample before
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration_ = Eigen::Vector3d::Zero();
};

}  // namespace cairn
