// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "common/base/result.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Where a sensor of a recording sits on the body that carries it, as EuRoC's sensor.yaml says.
struct SensorMount {
  SE3 body_from_sensor;   ///< T_BS [m]
  bool is_camera = true;  ///< sensor_type is camera, or not said
};

/// Nothing for a file without T_BS. Errors: kNotFound, kIo, kConfiguration (T_BS is no rigid motion).
[[nodiscard]] Result<std::optional<SensorMount>> read_sensor_mount(const std::filesystem::path& path);

/// How a camera goes with an IMU, as Kalibr says in its camchain.
struct KalibrImu {
  SE3 camera_from_imu;    ///< T_cam_imu [m]
  double time_shift = 0;  ///< timeshift_cam_imu [s]: the IMU's time is the camera's and this
};

/// Of cam0. Nothing for a file without T_cam_imu. Errors: kNotFound, kIo, kConfiguration (T_cam_imu is no
/// rigid motion, or the time shift no number).
[[nodiscard]] Result<std::optional<KalibrImu>> read_kalibr_imu(const std::filesystem::path& path);

}  // namespace cairn
