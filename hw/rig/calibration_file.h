// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "common/base/result.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// The lines of a configuration that say it, from `calibration:` on. Pure.
[[nodiscard]] std::string lines_of(const RigCalibration& calibration, bool has_imu);

/// `text`, that of a configuration, with the calibration in place of its own, or ahead of its `axes`; the
/// rest and its comments as they were. Without an IMU, what is of it stays. Pure.
[[nodiscard]] std::string with_calibration(const std::string& text, const RigCalibration& calibration,
                                           bool has_imu);

/// Checks whether write_calibration() could write beside that file. Error kConfiguration, with the reason.
[[nodiscard]] Status check_calibration_can_be_written(const std::filesystem::path& path);

/// Puts the calibration into a configuration file, at once and whole, and leaves the former as PATH.old. What
/// was written is read again before. Error kConfiguration; the file is then as it was.
[[nodiscard]] Status write_calibration(const std::filesystem::path& path, const RigCalibration& calibration);

}  // namespace cairn
