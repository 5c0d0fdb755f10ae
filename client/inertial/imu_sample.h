// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <chrono>

#include "common/base/time.h"

namespace cairn {

/// The measurements of an inertial measurement unit at a moment, in its own axes.
struct ImuSample {
  Timestamp time;                                          ///< by the IMU's clock
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();          ///< of turn [rad/s]
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();  ///< [m/s^2], with what holds it up: up at rest
};

/// How an IMU's axes and clock relate to a camera's. Where on the body it sits does not matter to rotations.
struct ImuMount {
  Eigen::Quaterniond camera_from_imu = Eigen::Quaterniond::Identity();
  std::chrono::nanoseconds clock_offset{0};  ///< what the IMU's stamps lack to the camera's

  bool operator==(const ImuMount& other) const {
    return camera_from_imu.coeffs() == other.camera_from_imu.coeffs() && clock_offset == other.clock_offset;
  }
};

}  // namespace cairn
