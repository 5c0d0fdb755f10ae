// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

/// The bias of a gyro, from the turns between two frames that both gyro and images tell: a Kalman filter
/// with the same variance for each axis. Pure.
class GyroBias {
 public:
  /// A turn over `seconds` as the images saw it, and as the gyro did with the present bias taken off.
  void learn(const Eigen::Quaterniond& seen, const Eigen::Quaterniond& measured, double seconds);

  [[nodiscard]] const Eigen::Vector3d& value() const { return value_; }  ///< camera axes [rad/s]
  [[nodiscard]] double sigma() const { return sigma_; }                  ///< per axis [rad/s]
  /// Whether the gyro has left a third or more of the turns of the last second unexplained: as much as is new
  /// in them.
  [[nodiscard]] bool leaves_turns_unexplained() const;

 private:
  Eigen::Vector3d value_ = Eigen::Vector3d::Zero();
  double sigma_ = 0.02;  ///< what small devices have out of the box: a degree a second
  double turned_ = 0;    ///< mean angle of late [rad]
  double left_ = 0;      ///< likewise, of what the gyro did not say
};

}  // namespace cairn
