// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"

#include <algorithm>
#include <fstream>
#include <iomanip>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <utility>

#include "common/base/stream_writer.h"
#include "common/geometry/camera_guess.h"
#include "common/image/limits.h"
#include "common/io/calibration_formats.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using calibration::wrong;

constexpr size_t kMaxCalibrationBytes = size_t{1} << 20;
constexpr size_t kRadtanValues = 9;

/// `chain.yaml#cam1`, unless a file has that very name: the file, and the camera in it.
std::pair<std::filesystem::path, std::string> split_camera(const std::filesystem::path& path) {
  const std::string text = path.string();
  const size_t mark = text.rfind('#');
  std::error_code error;
  const bool names_folder = mark != std::string::npos && text.find('/', mark) != std::string::npos;
  if (mark == std::string::npos || names_folder || std::filesystem::exists(path, error)) return {path, ""};
  return {text.substr(0, mark), text.substr(mark + 1)};
}

/// Whether the distortion can be undone half-way to the longer sides of the image; a fisheye may show no
/// more.
bool can_be_undone(const Camera& camera) {
  const double radius = 0.25 * std::min(camera.width(), camera.height());
  const Eigen::Vector2d middle(0.5 * (camera.width() - 1), 0.5 * (camera.height() - 1));
  constexpr double kClose = 0.5;  // [px]
  for (const Eigen::Vector2d& side : {Eigen::Vector2d(radius, 0), Eigen::Vector2d(0, radius)}) {
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(middle - side), Eigen::Vector2d(middle + side)}) {
      const auto back = camera.project(camera.unproject(pixel));
      if (!back || (*back - pixel).norm() > kClose) return false;
    }
  }
  return true;
}

/// Why no camera of images can be so, or nothing: a slip of the pen that would cost a map, told before it
/// does.
std::string implausible(const Camera& camera) {
  const int width = camera.width();
  const int height = camera.height();
  const auto& v = camera.parameters().values;
  std::ostringstream why;
  if (!is_focal_length(v[0], width, height) || !is_focal_length(v[1], width, height)) {
    why << "focal lengths " << v[0] << " and " << v[1] << " px for an image of " << width << "x" << height;
  } else if (!is_pixel_aspect(v[1] / v[0])) {
    why << "focal lengths " << v[0] << " and " << v[1] << " px, far from each other";
  } else if (!camera.in_image({v[2], v[3]})) {
    why << "the principal point " << v[2] << ", " << v[3] << " lies outside the image of " << width << "x"
        << height;
  } else if (!can_be_undone(camera)) {
    why << "its distortion folds the image over half-way to its edge";
  }
  return why.str();
}

/// Reads the file in the format that its content looks like.
Result<CameraParameters> parse_as_told(const calibration::File& file) {
  using namespace calibration;
  if (looks_like_xml(file.content)) return parse_xml(file);
  if (looks_like_orb_slam(file.content)) return parse_orb_slam(file);  // these two may look like YAML, too
  if (looks_like_kitti(file.content)) return parse_kitti(file);
  if (looks_like_yaml(file.content)) return parse_yaml(file);
  if (looks_like_colmap(file.content)) return parse_colmap(file);
  if (looks_like_dso(file.content)) return parse_dso(file);
  return parse_text(file);
}

/// The lens in words.
std::string_view lens_of(const CameraParameters& camera) {
  switch (camera.model) {
    case CameraModel::kKannalaBrandt:
      return "Kannala-Brandt fisheye";
    case CameraModel::kFov:
      return "FOV lens (PTAM's)";
    case CameraModel::kPinholeRadtan:
      break;
  }
  const bool is_straight =
      std::all_of(camera.values.begin() + 4, camera.values.end(), [](double v) { return v == 0; });
  return is_straight ? "pinhole without distortion" : "pinhole with radial-tangential distortion";
}

/// A text stream that writes doubles as they are, with the comment at its top.
std::ostringstream start_text(std::string_view comment) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << std::setprecision(std::numeric_limits<double>::max_digits10);
  for (const auto& line : all_lines(comment)) text << "# " << line.text << '\n';
  return text;
}

std::string format_txt(const CameraParameters& parameters, std::string_view comment) {
  auto text = start_text(comment);
  text << "# width height fx fy cx cy k1 k2 p1 p2 k3 (OpenCV); pixel centres at whole numbers\n";
  text << parameters.width << ' ' << parameters.height;
  auto values = parameters.values;
  values.resize(kRadtanValues, 0.0);
  for (const double value : values) text << ' ' << value;
  text << '\n';
  return text.str();
}

std::string_view kalibr_name(CameraModel model) {
  switch (model) {
    case CameraModel::kKannalaBrandt:
      return "equidistant";
    case CameraModel::kFov:
      return "fov";
    case CameraModel::kPinholeRadtan:
      return "radtan";
  }
  return "";
}

void list(std::ostream& out, const double* begin, const double* end) {
  out << '[';
  for (const double* value = begin; value != end; ++value) out << (value == begin ? "" : ", ") << *value;
  out << "]\n";
}

/// Values of a model in Kalibr's files: its radial-tangential has no k3.
size_t kalibr_count(CameraModel model) {
  switch (model) {
    case CameraModel::kKannalaBrandt:
    case CameraModel::kPinholeRadtan:
      return 8;
    case CameraModel::kFov:
      return 5;
  }
  return 0;
}

std::string format_kalibr(const CameraParameters& parameters, std::string_view comment) {
  auto values = parameters.values;
  values.resize(kalibr_count(parameters.model), 0.0);
  auto text = start_text(comment);
  text << "cam0:\n  camera_model: pinhole\n  intrinsics: ";
  list(text, values.data(), values.data() + 4);
  text << "  distortion_model: " << kalibr_name(parameters.model) << "\n  distortion_coeffs: ";
  list(text, values.data() + 4, values.data() + values.size());
  text << "  resolution: [" << parameters.width << ", " << parameters.height << "]\n";
  return text.str();
}

/// A file appears under its name when it is complete. What is no file (/dev/stdout) is not replaced by one.
Status write_whole(const std::filesystem::path& path, const std::string& text) {
  std::error_code error;
  const bool replaces =
      !std::filesystem::exists(path, error) || std::filesystem::is_regular_file(path, error);
  if (!replaces) return write_stream(path, text);
  auto staged = path;
  staged += ".part";
  {
    std::ofstream file(staged, std::ios::binary | std::ios::trunc);
    file << text;
    file.flush();
    if (!file) {
      const auto refused = fail(ErrorCode::kIo, cannot_be_written(path));
      std::filesystem::remove(staged, error);
      return refused;
    }
  }
  std::filesystem::rename(staged, path, error);
  if (error) return fail(ErrorCode::kIo, path.string() + ": cannot be written: " + error.message());
  return {};
}

}  // namespace

std::filesystem::path calibration_file(const std::filesystem::path& name) {
  return split_camera(name).first;
}

Result<CameraParameters> read_calibration(const std::filesystem::path& name,
                                          std::optional<ImageSize> image_size) {
  const auto [path, camera_name] = split_camera(name);
  auto content = read_text_file(path, kMaxCalibrationBytes);
  if (!content) {
    auto& error = content.error();
    if (error.code == ErrorCode::kDamaged) return wrong(error.message);
    error.message += "; pass --calibration FILE";
    return tl::unexpected(error);
  }
  const calibration::File file{path, *content, image_size, camera_name};
  auto parameters = parse_as_told(file);
  if (!parameters) return parameters;
  const auto camera = make_camera(*parameters);
  if (!camera) return wrong(path.string() + ": " + camera.error().message);
  if (parameters->width > kMaxImageSide || parameters->height > kMaxImageSide) {
    return wrong(path.string() + ": " + std::to_string(parameters->width) + "x" +
                 std::to_string(parameters->height) + " px; at most " + std::to_string(kMaxImageSide) +
                 " a side are served: scale images and calibration down");
  }
  if (const std::string why = implausible(**camera); !why.empty())
    return wrong(path.string() + ": " + why +
                 "; is it the calibration of this camera, in pixels of this size?");
  return parameters;
}

std::string describe_camera(const CameraParameters& camera) {
  std::ostringstream text;
  text << lens_of(camera) << ", " << camera.width << "x" << camera.height << ", f " << std::fixed
       << std::setprecision(1) << camera.values[0] << " " << camera.values[1];
  return text.str();
}

Status write_calibration_txt(const std::filesystem::path& path, const CameraParameters& parameters,
                             std::string_view comment) {
  if (parameters.model != CameraModel::kPinholeRadtan) {
    return wrong(path.string() + ": camera.txt holds pinhole-radtan only, not " +
                 std::string(name_of(parameters.model)) + "; write Kalibr yaml");
  }
  return write_whole(path, format_txt(parameters, comment));
}

Result<std::string> format_calibration_kalibr(const CameraParameters& parameters, std::string_view comment) {
  if (parameters.model == CameraModel::kPinholeRadtan && parameters.values.size() == kRadtanValues &&
      parameters.values.back() != 0) {
    return wrong("Kalibr's radtan has no k3; write camera.txt");
  }
  return format_kalibr(parameters, comment);
}

Status write_calibration_kalibr(const std::filesystem::path& path, const CameraParameters& parameters,
                                std::string_view comment) {
  const auto text = format_calibration_kalibr(parameters, comment);
  return text ? write_whole(path, *text) : wrong(path.string() + ": " + text.error().message);
}

}  // namespace cairn
