// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string_view>

#include "common/base/result.h"
#include "common/geometry/camera.h"

namespace cairn {

/// Reads a calibration, its format told by its content:
///  * one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]` (camera.txt; '#' begins a comment), or
///  * OpenCV FileStorage YAML: camera_matrix, distortion_coefficients (4 or 5), image_width, image_height;
///  the camera_info
///    YAML of ROS with distortion_model plumb_bob has the same keys and is read too.
/// The result always has the nine values [fx fy cx cy k1 k2 p1 p2 k3] and makes a camera (make_camera). Pixel
/// (0,0) is the centre of the first pixel. Errors (kNotFound, kIo, kConfiguration) name file, line and
/// remedy. Thread-safe.
[[nodiscard]] Result<CameraParameters> read_calibration(const std::filesystem::path& path);

/// Writes camera.txt, whole or not at all; `comment` (how the numbers came about) goes before the line.
/// Values read back equal. Errors: kIo.
[[nodiscard]] Status write_calibration_txt(const std::filesystem::path& path,
                                           const CameraParameters& parameters, std::string_view comment = {});

}  // namespace cairn
