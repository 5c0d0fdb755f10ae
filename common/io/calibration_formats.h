// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/io/calibration.h"

// The formats behind read_calibration(), which has read the file and told the format. Within common/io only.
namespace cairn::calibration {

/// What a reader of one format is given; `path` for messages.
struct File {
  const std::filesystem::path& path;
  const std::string& content;
  std::optional<PictureSize> picture_size;
  std::string_view camera;  ///< which of a Kalibr camchain; empty: its only one
};

/// Whether the first line of data looks like YAML; else it is a text of numbers.
[[nodiscard]] bool looks_like_yaml(std::string_view content);

/// camera.txt, or PTAM's camera.cfg.
[[nodiscard]] Result<CameraParameters> parse_text(const File& file);
/// OpenCV, ROS, Kalibr or EuRoC, told by their keys.
[[nodiscard]] Result<CameraParameters> parse_yaml(const File& file);

[[nodiscard]] tl::unexpected<Error> wrong(std::string message);
/// For a camera that was named to a file whose format names none.
[[nodiscard]] tl::unexpected<Error> names_no_camera(const File& file);
/// Image sides come as numbers in every format; anything but a positive whole number is 0.
[[nodiscard]] int side_from_number(double value);

constexpr std::string_view kFormats =
    "expected one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]` (pixels), PTAM's camera.cfg, or a yaml "
    "of Kalibr, "
    "OpenCV or ROS";

}  // namespace cairn::calibration
