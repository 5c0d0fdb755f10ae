// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <vector>

#include "client/inertial/imu_sample.h"
#include "common/base/result.h"

namespace cairn {

/// The rows of an IMU's file: a time and twice three numbers, between commas or blanks. The time is in
/// nanoseconds if it is a whole number of 16 digits or more, else in seconds. Which three are accelerations
/// is what the heading says (EuRoC, TUM-VI: rates first), or else those that have gravity in them. Errors:
/// kNotFound, kIo, kDamaged (a row that is none, time that goes back or is 146 years from 1970, no two rows,
/// units other than rad/s and m/s^2, fewer than 20 samples a second or more than 10000), each with the line
/// or the remedy.
[[nodiscard]] Result<std::vector<ImuSample>> read_imu_file(const std::filesystem::path& path);

}  // namespace cairn
