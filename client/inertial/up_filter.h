// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

#include "common/geometry/up_direction.h"

namespace cairn {

struct UpFilterOptions {
  double late = 1.0;                  ///< [s] of which the shaking is a mean
  double accelerometer_sigma = 0.01;  ///< over g: bias of small devices, half a degree
  double shaken_for = 0.3;            ///< [s] a hand's accelerations last: samples within tell the same
  double most_sigma = 0.05;           ///< [rad] of a direction that is told
};

/// Estimates the direction up: the gyro carries it, and it is drawn to what the accelerometer says (a
/// complementary filter), the slower the more the camera is shaken. Pure.
class UpFilter {
 public:
  explicit UpFilter(const UpFilterOptions& options) : options_(options) {}

  /// Takes one sample, `step` [s] after the one before (0: the first): the rate of turn without bias, known
  /// to `rate_sigma` [rad/s], and the acceleration, in the camera's axes.
  void update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
              double rate_sigma);
  void reset() { *this = UpFilter(options_); }

  /// The direction at the newest sample. Nothing before the first, and while its sigma is above 3 degrees.
  [[nodiscard]] std::optional<UpDirection> up() const;

 private:
  UpFilterOptions options_;
  Eigen::Vector3d up_ = Eigen::Vector3d::Zero();
  double variance_ = 0;  ///< [rad^2]
  double shaken_ = 0;  ///< mean square of what the accelerometer measures besides gravity, of late, over g^2
  double age_ = 0;     ///< [s]
};

}  // namespace cairn
