// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

struct GyroBiasOptions {
  double first_sigma = 0.02;     ///< [rad/s] what small devices have out of the box: a degree a second
  double image_sigma = 1e-3;     ///< [rad] of the turn between two tracked frames: half a pixel
  double drift = 3e-4;           ///< [rad/s per square root of a second] warming up, small devices
  double gate = 4;               ///< [sigma] what is farther off is a frame tracked wrongly
  double forget = 0.05;          ///< of the means, a frame
  double unexplained = 1.0 / 3;  ///< of the turns, that contradicts the images
  double no_turn = 4;            ///< [image_sigma] what is left is noise
};

/// The bias of a gyro, from the turns between two frames that both gyro and images tell: a Kalman filter
/// with the same variance for each axis. Pure.
class GyroBias {
 public:
  explicit GyroBias(const GyroBiasOptions& options) : options_(options), sigma_(options.first_sigma) {}

  /// A turn over `seconds` as the images saw it, and as the gyro did with the present bias taken off.
  void learn(const Eigen::Quaterniond& seen, const Eigen::Quaterniond& measured, double seconds);

  [[nodiscard]] const Eigen::Vector3d& value() const { return value_; }  ///< camera axes [rad/s]
  [[nodiscard]] double sigma() const { return sigma_; }                  ///< per axis [rad/s]
  /// Whether the gyro has left more than a third of the turns of about the last second unexplained, and more
  /// than noise.
  [[nodiscard]] bool leaves_turns_unexplained() const;

 private:
  GyroBiasOptions options_;
  Eigen::Vector3d value_ = Eigen::Vector3d::Zero();
  double sigma_ = 0;
  double turned_ = 0;  ///< mean angle of late [rad]
  double left_ = 0;    ///< likewise, of what the gyro did not say
};

}  // namespace cairn
