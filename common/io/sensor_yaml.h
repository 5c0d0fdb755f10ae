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

}  // namespace cairn
