// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "common/geometry/camera.h"

namespace cairn {

/// Reads a calibration, its format told by its content:
///  * one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]` (camera.txt; '#' begins a comment; blanks
///  between numbers);
///  * Kalibr's camchain yaml (pinhole with radtan, equidistant, fov or none), and EuRoC's sensor.yaml;
///  * OpenCV's FileStorage, yaml or XML: camera_matrix, distortion_coefficients, image_width, image_height; a
///  `fisheye_model` other than 0 is Kannala-Brandt;
///  * ROS' camera_info, as its yaml or as `ros2 topic echo` prints it (the first message): distortion_model
///  plumb_bob, rational_polynomial (its denominator being one), equidistant or fisheye;
///  * the settings of ORB-SLAM2 and 3 and of VINS' cameras, COLMAP's cameras.txt, the four lines of LSD-SLAM
///  and DSO, KITTI's calib.txt and calib_cam_to_cam.txt;
///  * PTAM's camera.cfg, `Camera.Parameters=[ fx fy cx cy w ]` in units of the image's sides, or its five
///  numbers alone.
/// Of several cameras `FILE#NAME` takes one: cam1 (Kalibr), Camera2 (ORB-SLAM), an id (COLMAP), P2 or K_02
/// (KITTI). `image_size` must be given for PTAM, and where ORB-SLAM or KITTI do not say it.
/// Pinhole-radtan has all nine values [fx fy cx cy k1 k2 p1 p2 k3]. The result makes a camera (make_camera).
/// Pixel (0,0) is the centre of the first pixel. Errors (kNotFound, kIo, kConfiguration: also for what no
/// camera can be, a principal point beside the image, say) name file, line and remedy. Thread-safe.
[[nodiscard]] Result<CameraParameters> read_calibration(const std::filesystem::path& path,
                                                        std::optional<ImageSize> image_size = {});
/// The file that read_calibration() reads for a name, which may be `FILE#NAME`.
[[nodiscard]] std::filesystem::path calibration_file(const std::filesystem::path& name);

/// A camera in words, for logs: "Kannala-Brandt fisheye, 640x480, f 320.1 320.3". Of what make_camera()
/// takes.
[[nodiscard]] std::string describe_camera(const CameraParameters& camera);

/// Writes camera.txt, whole or not at all; `comment` (how the numbers came about) goes before the line.
/// Values read back equal. Errors: kIo; kConfiguration for a model other than pinhole-radtan.
[[nodiscard]] Status write_calibration_txt(const std::filesystem::path& path,
                                           const CameraParameters& parameters, std::string_view comment = {});

/// Kalibr's yaml with one camera, cam0: every model, but kConfiguration for a k3, which Kalibr does not have.
[[nodiscard]] Result<std::string> format_calibration_kalibr(const CameraParameters& parameters,
                                                            std::string_view comment = {});

/// Writes it. Otherwise as write_calibration_txt().
[[nodiscard]] Status write_calibration_kalibr(const std::filesystem::path& path,
                                              const CameraParameters& parameters,
                                              std::string_view comment = {});

}  // namespace cairn
