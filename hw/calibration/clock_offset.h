// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <deque>
#include <optional>
#include <span>

#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {

/// A sample of a gyro: the mean rate since the sample before, in the IMU's axes [rad/s].
struct GyroSample {
  Timestamp when;  ///< the end of it, by the IMU's clock
  Eigen::Vector3d rate;
};

/// The rotation of a camera, as a tracker tells it.
struct CameraRotation {
  Timestamp when;  ///< by the camera's clock
  Eigen::Quaterniond map_from_camera;
};

/// How gyro and camera go with each other, from a motion that both have seen.
struct CameraAndGyro {
  double offset = 0;       ///< the IMU's stamp of a moment less the camera's [s]
  double sigma = 0;        ///< standard deviation of that [s]
  double residual = 0;     ///< RMS of the camera's rate less the gyro's [rad/s]
  double correlation = 0;  ///< share of the camera's turning that the gyro explains: 0 to 1
  Eigen::Vector3d bias;    ///< of the gyro, in its axes [rad/s]
  Eigen::Quaterniond camera_from_imu;
  bool rotation_known = false;  ///< camera_from_imu: not from turning about one axis only
};

/// Aligns gyro and camera: shifts the one against the other until they agree. Stamps in ascending order;
/// offsets up to 0.3 s are found. Errors: kRefused for too few images and for a camera that hardly turned;
/// kConfiguration for two that do not turn alike. The message says what to do. Pure.
[[nodiscard]] Result<CameraAndGyro> align_camera_and_gyro(std::span<const GyroSample> gyro,
                                                          std::span<const CameraRotation> camera);

/// The same for a rig at work: from the last 20 seconds of both. One whose stamps run back begins anew. Pure.
class ClockOffset {
 public:
  void sense(const GyroSample& sample);
  void see(const CameraRotation& rotation);
  /// Forgets the camera's rotations: those to come are of another camera.
  void forget_camera() { camera_.clear(); }

  /// Some hundredths of a second of work: once in a few seconds is enough. Errors: as above.
  [[nodiscard]] Result<CameraAndGyro> estimate() const;

 private:
  std::deque<GyroSample> gyro_;
  std::deque<CameraRotation> camera_;
};

}  // namespace cairn
