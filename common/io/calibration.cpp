// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"

#include <fstream>
#include <iomanip>
#include <limits>
#include <locale>
#include <sstream>
#include <string>

#include "common/image/limits.h"
#include "common/io/calibration_formats.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using calibration::wrong;

constexpr size_t kMaxCalibrationBytes = size_t{1} << 20;
constexpr size_t kRadtanValues = 9;
constexpr size_t kKalibrRadtanValues = 8;

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

std::string format_kalibr(const CameraParameters& parameters, std::string_view comment) {
  const size_t count = parameters.model == CameraModel::kFov ? 5 : kKalibrRadtanValues;
  auto values = parameters.values;
  values.resize(count, 0.0);
  auto text = start_text(comment);
  text << "cam0:\n  camera_model: pinhole\n  intrinsics: ";
  list(text, values.data(), values.data() + 4);
  text << "  distortion_model: " << kalibr_name(parameters.model) << "\n  distortion_coeffs: ";
  list(text, values.data() + 4, values.data() + values.size());
  text << "  resolution: [" << parameters.width << ", " << parameters.height << "]\n";
  return text.str();
}

/// The file appears under its name when it is complete.
Status write_whole(const std::filesystem::path& path, const std::string& text) {
  auto staged = path;
  staged += ".part";
  {
    std::ofstream file(staged, std::ios::binary | std::ios::trunc);
    file << text;
    file.flush();
    if (!file) return fail(ErrorCode::kIo, cannot_be_written(staged));
  }
  std::error_code error;
  std::filesystem::rename(staged, path, error);
  if (error) return fail(ErrorCode::kIo, path.string() + ": cannot be written: " + error.message());
  return {};
}

}  // namespace

Result<CameraParameters> read_calibration(const std::filesystem::path& path,
                                          std::optional<PictureSize> picture_size) {
  auto content = read_file(path, kMaxCalibrationBytes);
  if (!content) {
    content.error().message += "; pass --calibration FILE";
    return tl::unexpected(content.error());
  }
  const calibration::File file{path, *content, picture_size};
  auto parameters =
      calibration::looks_like_yaml(*content) ? calibration::parse_yaml(file) : calibration::parse_text(file);
  if (!parameters) return parameters;
  if (const auto camera = make_camera(*parameters); !camera)
    return wrong(path.string() + ": " + camera.error().message);
  if (parameters->width > kMaxImageSide || parameters->height > kMaxImageSide) {
    return wrong(path.string() + ": " + std::to_string(parameters->width) + "x" +
                 std::to_string(parameters->height) + " px; at most " + std::to_string(kMaxImageSide) +
                 " a side are served: scale pictures and calibration down");
  }
  return parameters;
}

Status write_calibration_txt(const std::filesystem::path& path, const CameraParameters& parameters,
                             std::string_view comment) {
  if (parameters.model != CameraModel::kPinholeRadtan) {
    return wrong(path.string() + ": camera.txt holds pinhole-radtan only, not " +
                 std::string(name_of(parameters.model)) + "; write Kalibr yaml");
  }
  return write_whole(path, format_txt(parameters, comment));
}

Status write_calibration_kalibr(const std::filesystem::path& path, const CameraParameters& parameters,
                                std::string_view comment) {
  if (parameters.model == CameraModel::kPinholeRadtan && parameters.values.size() == kRadtanValues &&
      parameters.values.back() != 0) {
    return wrong(path.string() + ": Kalibr's radtan has no k3; write camera.txt");
  }
  return write_whole(path, format_kalibr(parameters, comment));
}

}  // namespace cairn
