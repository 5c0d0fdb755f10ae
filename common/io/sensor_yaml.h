// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "common/geometry/se3.h"

namespace cairn {

/// Where a sensor of a recording sits on the body that carries it, as EuRoC's sensor.yaml says.
struct SensorMount {
  SE3 body_from_sensor;  ///< T_BS [m]
  std::string type;      ///< sensor_type; empty: not said

  /// Whether the sensor is of the wanted type, or its type is not said.
  [[nodiscard]] bool may_be(std::string_view wanted) const { return type.empty() || type == wanted; }
};

/// Reads a sensor.yaml. Nothing for a file without T_BS. Errors: those of read_text_file(), and
/// kConfiguration (no YAML, or T_BS is no rigid motion).
[[nodiscard]] Result<std::optional<SensorMount>> read_sensor_mount(const std::filesystem::path& path);

/// How a camera goes with an IMU, as Kalibr says in its camchain.
struct KalibrImu {
  SE3 camera_from_imu;    ///< T_cam_imu [m]
  double time_shift = 0;  ///< timeshift_cam_imu [s]: the IMU's time is the camera's plus this
};

/// Reads how cam0 of a camchain goes with its IMU. Nothing for a file without T_cam_imu. Errors: those of
/// read_text_file(), and kConfiguration (no YAML, T_cam_imu is no rigid motion, or the time shift is not
/// within +-1e9 s).
[[nodiscard]] Result<std::optional<KalibrImu>> read_kalibr_imu(const std::filesystem::path& path);

}  // namespace cairn
