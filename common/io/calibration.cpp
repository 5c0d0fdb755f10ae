// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <vector>

#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kMaxCalibrationBytes = size_t{1} << 20;
constexpr size_t kRadtanValues = 9;
constexpr std::string_view kTxtFormat =
    "expected one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]` (pixels) or an OpenCV calibration YAML";

tl::unexpected<Error> wrong(std::string message) {
  return fail(ErrorCode::kConfiguration, std::move(message));
}

/// Image sides come as numbers in every format; anything but a positive whole number is 0.
int side_from_number(double value) {
  if (!(value >= 1) || value > std::numeric_limits<int>::max() || value != std::floor(value)) return 0;
  return static_cast<int>(value);
}

Result<CameraParameters> parse_txt(const std::filesystem::path& path, std::string_view content) {
  const auto lines = data_lines(content);
  if (lines.empty()) return wrong(path.string() + ": no calibration in it; " + std::string(kTxtFormat));
  if (lines.size() > 1) {
    return wrong(at_line(path, lines[1].number, "a second line of data; " + std::string(kTxtFormat)));
  }
  const auto& line = lines.front();
  const auto fields = split_fields(line.text.substr(0, line.text.find('#')));
  std::vector<double> numbers;
  for (const auto field : fields) {
    const auto number = parse_number(field);
    if (!number) {
      return wrong(
          at_line(path, line.number, in_quotes(field) + " is not a number; " + std::string(kTxtFormat)));
    }
    numbers.push_back(*number);
  }
  if (numbers.size() != 6 && numbers.size() != 10 && numbers.size() != 11) {
    return wrong(
        at_line(path, line.number,
                std::to_string(numbers.size()) + " numbers, not 6, 10 or 11; " + std::string(kTxtFormat)));
  }
  CameraParameters parameters;
  parameters.width = side_from_number(numbers[0]);
  parameters.height = side_from_number(numbers[1]);
  parameters.values.assign(numbers.begin() + 2, numbers.end());
  parameters.values.resize(kRadtanValues, 0.0);
  if (parameters.width == 0 || parameters.height == 0) {
    return wrong(at_line(path, line.number, "image width and height must be positive whole numbers"));
  }
  return parameters;
}

/// Reads the keys of one YAML document; each error names the file and, where the key exists, its line.
class YamlCalibration {
 public:
  YamlCalibration(const std::filesystem::path& path, YAML::Node root) : path_(path), root_(std::move(root)) {}

  [[nodiscard]] Result<CameraParameters> parse() const {
    if (!root_.IsMap()) return wrong(path_.string() + ": not a calibration; " + std::string(kTxtFormat));
    if (const auto model = root_["distortion_model"]; model && model.as<std::string>("") != "plumb_bob") {
      return error_at(model, "distortion_model '" + model.as<std::string>("?") +
                                 "' is not read; calibrate with plumb_bob");
    }
    const auto width = number("image_width");
    const auto height = number("image_height");
    const auto matrix = matrix_data("camera_matrix");
    const auto distortion = matrix_data("distortion_coefficients");
    if (!width) return tl::unexpected(width.error());
    if (!height) return tl::unexpected(height.error());
    if (!matrix) return tl::unexpected(matrix.error());
    if (!distortion) return tl::unexpected(distortion.error());
    return assemble(*width, *height, *matrix, *distortion);
  }

 private:
  [[nodiscard]] tl::unexpected<Error> error_at(const YAML::Node& node, const std::string& message) const {
    return wrong(at_line(path_, static_cast<size_t>(node.Mark().line + 1), message));
  }

  [[nodiscard]] Result<double> number(const char* key) const {
    const auto node = root_[key];
    if (!node) return wrong(path_.string() + ": no '" + key + "' in it; calibrate again or add it");
    const auto value = node.IsScalar() ? parse_number(node.Scalar()) : std::nullopt;
    if (!value) return error_at(node, std::string(key) + " is not a number");
    return *value;
  }

  [[nodiscard]] Result<std::vector<double>> matrix_data(const char* key) const {
    const auto node = root_[key];
    if (!node) return wrong(path_.string() + ": no '" + key + "' in it; calibrate again or add it");
    const auto data = node.IsMap() ? node["data"] : node;
    if (!data || !data.IsSequence()) return error_at(node, std::string(key) + " has no list 'data'");
    std::vector<double> values;
    for (const auto& item : data) {
      const auto value = item.IsScalar() ? parse_number(item.Scalar()) : std::nullopt;
      if (!value) return error_at(item, std::string(key) + ": not a number");
      values.push_back(*value);
    }
    return values;
  }

  [[nodiscard]] Result<CameraParameters> assemble(double width, double height,
                                                  const std::vector<double>& matrix,
                                                  std::vector<double> distortion) const {
    if (matrix.size() != 9 || matrix[1] != 0 || matrix[3] != 0) {
      return error_at(root_["camera_matrix"], "camera_matrix must be 3x3, [fx 0 cx; 0 fy cy; 0 0 1]");
    }
    // The rational model writes its five numbers first; it is ours when the rest is zero.
    while (distortion.size() > 5 && distortion.back() == 0) distortion.pop_back();
    if (distortion.size() > 5) {
      return error_at(root_["distortion_coefficients"],
                      "more than 5 distortion coefficients; calibrate without the rational, thin prism and "
                      "tilted models");
    }
    CameraParameters parameters;
    parameters.width = side_from_number(width);
    parameters.height = side_from_number(height);
    if (parameters.width == 0)
      return error_at(root_["image_width"], "image_width must be a positive whole number");
    if (parameters.height == 0)
      return error_at(root_["image_height"], "image_height must be a positive whole number");
    parameters.values = {matrix[0], matrix[4], matrix[2], matrix[5]};
    parameters.values.insert(parameters.values.end(), distortion.begin(), distortion.end());
    parameters.values.resize(kRadtanValues, 0.0);
    return parameters;
  }

  const std::filesystem::path& path_;
  YAML::Node root_;
};

Result<CameraParameters> parse_yaml(const std::filesystem::path& path, const std::string& content) {
  try {
    return YamlCalibration(path, YAML::Load(content)).parse();
  } catch (const YAML::Exception& error) {
    const auto line = static_cast<size_t>(std::max(0, error.mark.line) + 1);
    return wrong(at_line(path, line, "not YAML: " + error.msg));
  }
}

bool looks_like_yaml(std::string_view content) {
  const auto lines = data_lines(content);
  return !lines.empty() && (lines[0].text.front() == '%' || lines[0].text.starts_with("---") ||
                            lines[0].text.find(':') != std::string::npos);
}

std::string format_txt(const CameraParameters& parameters, std::string_view comment) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  for (const auto& line : all_lines(comment)) text << "# " << line.text << '\n';
  text << "# width height fx fy cx cy k1 k2 p1 p2 k3 (OpenCV); pixel centres at whole numbers\n";
  text << parameters.width << ' ' << parameters.height
       << std::setprecision(std::numeric_limits<double>::max_digits10);
  auto values = parameters.values;
  values.resize(kRadtanValues, 0.0);
  for (const double value : values) text << ' ' << value;
  text << '\n';
  return text.str();
}

}  // namespace

Result<CameraParameters> read_calibration(const std::filesystem::path& path) {
  auto content = read_file(path, kMaxCalibrationBytes);
  if (!content) {
    content.error().message += "; pass --calibration FILE";
    return tl::unexpected(content.error());
  }
  auto parameters = looks_like_yaml(*content) ? parse_yaml(path, *content) : parse_txt(path, *content);
  if (!parameters) return parameters;
  if (const auto camera = make_camera(*parameters); !camera)
    return wrong(path.string() + ": " + camera.error().message);
  return parameters;
}

Status write_calibration_txt(const std::filesystem::path& path, const CameraParameters& parameters,
                             std::string_view comment) {
  auto staged = path;
  staged += ".part";
  {
    std::ofstream file(staged, std::ios::binary | std::ios::trunc);
    file << format_txt(parameters, comment);
    file.flush();
    if (!file) return fail(ErrorCode::kIo, staged.string() + ": cannot be written");
  }
  std::error_code error;
  std::filesystem::rename(staged, path, error);
  if (error) return fail(ErrorCode::kIo, path.string() + ": cannot be written: " + error.message());
  return {};
}

}  // namespace cairn
