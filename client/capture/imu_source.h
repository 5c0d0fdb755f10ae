// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/inertial/imu_stream.h"
#include "common/base/result.h"

namespace cairn {

/// A person's words about the IMU on a recording's camera.
struct ImuRequest {
  /// A file of samples, or a folder as EuRoC's imu0; nothing: what the source has by itself.
  std::optional<std::filesystem::path> samples;
  /// `qx,qy,qz,qw` of camera_from_imu, or a file: Kalibr's camchain with T_cam_imu, or the camera's
  /// sensor.yaml with T_BS. Nothing: as the sensor.yaml beside samples and images say.
  std::string mount;
  std::optional<std::chrono::nanoseconds> clock_offset;  ///< ImuMount's; nothing: Kalibr's, else 0
};

struct OpenedImu {
  ImuStreamPtr stream;            ///< null: there is none, or it is not known how it sits
  std::vector<SourceNote> notes;  ///< what a person should know
};

/// The samples of an `euroc:` or `tum:` source (imu0/data.csv beside the camera's folder; imu.csv, imu.txt or
/// imu0/data.csv in it), those asked for, or the source's own. What lies beside the images and whose mount
/// is not said is not used, and a note tells; errors: those of read_imu_file(); kConfiguration (asked for,
/// and its mount is not said, or no file of one), kUsage (with a live camera, which has other clocks),
/// kDamaged (samples of another time than the frames).
[[nodiscard]] Result<OpenedImu> open_imu(std::string_view uri, FrameSource& source,
                                         const ImuRequest& request);

}  // namespace cairn
