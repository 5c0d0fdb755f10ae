// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace cairn {

/// Numbers on the wire and in files; grow only at the end. README.md says what a new model needs besides.
enum class CameraModel : uint8_t {
  kPinholeRadtan = 0,  ///< [fx fy cx cy k1 k2 p1 p2 k3], OpenCV's plumb bob; k3 may be 0
  kKannalaBrandt = 1,  ///< [fx fy cx cy k1 k2 k3 k4], OpenCV's fisheye, Kalibr's equidistant
  kFov = 2,            ///< [fx fy cx cy w], Devernay and Faugeras, PTAM's; w = 0 is a pinhole
};

/// Whether a number from the wire or a file is that of a model.
[[nodiscard]] bool is_camera_model(int number);
/// All camera models that there are, in the order in which camera.cpp registers them.
[[nodiscard]] std::vector<CameraModel> camera_models();
/// pinhole-radtan, kb4 or fov.
[[nodiscard]] std::string_view name_of(CameraModel model);

/// Everything that defines a camera. Pixels; (0,0) is the centre of the first pixel.
struct CameraParameters {
  CameraModel model = CameraModel::kPinholeRadtan;
  int width = 0;
  int height = 0;
  std::vector<double>
      values;  ///< in the order of the model's comment; missing trailing distortion terms are 0
  bool operator==(const CameraParameters&) const = default;
};

/// The size of an image [px].
struct ImageSize {
  int width = 0;
  int height = 0;
  bool operator==(const ImageSize&) const = default;
};

using Matrix23d = Eigen::Matrix<double, 2, 3>;

/// A calibrated camera: immutable, shared between threads without locks.
class Camera {
 public:
  virtual ~Camera() = default;

  /// Pixel of a point in camera coordinates (x right, y down, z forward; any unit). Nothing for the camera's
  /// centre and beyond the angle to which the distortion is monotonic: for a pinhole at most 90 degrees off
  /// the axis, while kb4 and fov may reach behind the camera (depth <= 0). The pixel may lie outside the
  /// image.
  [[nodiscard]] virtual std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point) const = 0;
  /// Projects as project(point) does, and writes the derivative of the pixel by the point (2x3, pixels per
  /// unit of the point).
  [[nodiscard]] virtual std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point,
                                                               Matrix23d* d_pixel_d_point) const = 0;
  /// Unit ray in camera coordinates through a pixel; project(unproject(p)) == p within 1e-6 px inside the
  /// image. A pixel that no ray reaches gives the nearest ray at the rim of the valid field.
  [[nodiscard]] virtual Eigen::Vector3d unproject(const Eigen::Vector2d& pixel) const = 0;
  /// d pixel / d parameters (2 x parameters().values.size()) at a point that projects; for calibration.
  [[nodiscard]] virtual Eigen::Matrix2Xd d_pixel_d_parameters(const Eigen::Vector3d& point) const = 0;

  [[nodiscard]] const CameraParameters& parameters() const { return parameters_; }
  [[nodiscard]] int width() const { return parameters_.width; }
  [[nodiscard]] int height() const { return parameters_.height; }
  /// Mean focal length [px].
  [[nodiscard]] double focal_length() const { return 0.5 * (parameters_.values[0] + parameters_.values[1]); }
  /// Whether a pixel lies at least `border` px inside the image.
  [[nodiscard]] bool in_image(const Eigen::Vector2d& pixel, double border = 0) const {
    return pixel.x() >= border && pixel.y() >= border && pixel.x() <= width() - 1 - border &&
           pixel.y() <= height() - 1 - border;
  }

 protected:
  explicit Camera(CameraParameters parameters) : parameters_(std::move(parameters)) {}

 private:
  CameraParameters parameters_;
};

using CameraPtr = std::shared_ptr<const Camera>;

/// The camera of the given parameters, or what is wrong with them (count, finiteness, focal length <= 0,
/// size).
[[nodiscard]] Result<CameraPtr> make_camera(const CameraParameters& parameters);

}  // namespace cairn
