// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <functional>

#include "common/base/time.h"
#include "common/geometry/se3.h"

namespace cairn {

struct SimImuSample {
  Timestamp time;
  Eigen::Vector3d rate;          ///< IMU axes [rad/s]
  Eigen::Vector3d acceleration;  ///< likewise [m/s^2]: up at rest
};

/// A small IMU on the back of a simulated camera: x where the camera looks, y left, z up, three centimetres
/// behind it. Bias and noise are those of devices that phones have. Sample i is a pure function of its index.
class SimImu {
 public:
  /// Samples in a second, and the seed of bias and noise.
  SimImu(double frequency, uint64_t seed);

  [[nodiscard]] SE3 camera_from_imu() const;
  /// Sample `index` of the IMU on a camera (map Z up) that moves so.
  [[nodiscard]] SimImuSample sample(int index, const std::function<SE3(double)>& map_from_camera) const;

 private:
  double frequency_;
  uint64_t seed_;
  Eigen::Vector3d rate_bias_;
  Eigen::Vector3d acceleration_bias_;
};

}  // namespace cairn
