// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/io/calibration.h"
#include "common/io/text.h"

// The formats behind read_calibration(), which has read the file and told the format. Within common/io only.
namespace cairn::calibration {

/// The input of the reader of one format; `path` for messages.
struct File {
  const std::filesystem::path& path;
  const std::string& content;
  std::optional<ImageSize> image_size;
  std::string_view camera;  ///< which of several; empty: the only one
};

/// How the coefficients after the four linear numbers describe a lens's distortion.
enum class Distortion { kRadtan, kEquidistant, kFov, kNone };

/// OpenCV's FileStorage as XML.
[[nodiscard]] bool looks_like_xml(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_xml(const File& file);
/// The settings of ORB-SLAM2 and ORB-SLAM3: lines `Camera.fx: 500`, which YAML's grammar does not always fit.
[[nodiscard]] bool looks_like_orb_slam(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_orb_slam(const File& file);
/// KITTI's calib.txt and calib_cam_to_cam.txt.
[[nodiscard]] bool looks_like_kitti(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_kitti(const File& file);
/// OpenCV, ROS, Kalibr, EuRoC or VINS, told by their keys.
[[nodiscard]] bool looks_like_yaml(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_yaml(const File& file);
/// COLMAP's cameras.txt.
[[nodiscard]] bool looks_like_colmap(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_colmap(const File& file);
/// The four lines of LSD-SLAM's and DSO's calibrations.
[[nodiscard]] bool looks_like_dso(std::string_view content);
[[nodiscard]] Result<CameraParameters> parse_dso(const File& file);
/// camera.txt, or PTAM's camera.cfg: what nothing else is told to be.
[[nodiscard]] Result<CameraParameters> parse_text(const File& file);

[[nodiscard]] tl::unexpected<Error> wrong(std::string message);
/// The error for a camera that was named to a file whose format names none.
[[nodiscard]] tl::unexpected<Error> names_no_camera(const File& file);
/// Which of the cameras in a file is meant: the one that was named, or the only one.
[[nodiscard]] Result<std::string> choose_camera(const File& file, const std::vector<std::string>& names);
/// Image sides come as numbers in every format; anything but a positive whole number is 0.
[[nodiscard]] int side_from_number(double value);
/// All of the fields as numbers; nothing if one is none.
[[nodiscard]] std::optional<std::vector<double>> numbers_in(const std::vector<std::string_view>& fields);

/// The camera of four linear numbers (a pinhole without distortion) and its coefficients; zeros beyond what
/// the model has are left out. The error has no place yet.
[[nodiscard]] Result<CameraParameters> with_distortion(CameraParameters linear, Distortion distortion,
                                                       std::vector<double> coefficients);
/// fx fy cx cy in units of the image's sides, whose first pixel begins at 0, as PTAM, LSD-SLAM and DSO have
/// them.
[[nodiscard]] CameraParameters in_pixels(ImageSize size, const std::vector<double>& sides);

/// How many values a pinhole-radtan camera has.
constexpr size_t kRadtanValues = 9;

constexpr std::string_view kFormats =
    "expected one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]` (pixels), or the file of Kalibr, "
    "OpenCV, ROS, ORB-SLAM, VINS, COLMAP, LSD-SLAM, DSO, KITTI or PTAM";

}  // namespace cairn::calibration
