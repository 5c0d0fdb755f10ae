// SPDX-License-Identifier: Apache-2.0
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>

#include "common/io/calibration_formats.h"
#include "common/io/text.h"

namespace cairn::calibration {
namespace {

constexpr size_t kRadtanValues = 9;
constexpr size_t kFisheyeBends = 4;

/// Reads the keys of one YAML map; each error names the file and, where the key exists, its line.
class Keys {
 public:
  Keys(const File& file, const YAML::Node& root) : file_(file), root_(root) {}

  [[nodiscard]] bool has(const char* key) const { return static_cast<bool>(root_[key]); }
  [[nodiscard]] YAML::Node operator[](const char* key) const { return root_[key]; }

  [[nodiscard]] tl::unexpected<Error> error_at(const YAML::Node& node, const std::string& message) const {
    return wrong(at_line(file_.path, static_cast<size_t>(node.Mark().line + 1), message));
  }
  [[nodiscard]] tl::unexpected<Error> error_at(const char* key, const std::string& message) const {
    return error_at(root_[key], message);
  }
  [[nodiscard]] tl::unexpected<Error> missing(const char* key) const {
    return wrong(file_.path.string() + ": no '" + key + "' in it; calibrate again or add it");
  }

  [[nodiscard]] Result<int> side(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    const auto value = node.IsScalar() ? parse_number(node.Scalar()) : std::nullopt;
    if (!value) return error_at(node, std::string(key) + " is not a number");
    const int side = side_from_number(*value);
    if (side == 0) return error_at(node, std::string(key) + " must be a positive whole number");
    return side;
  }

  [[nodiscard]] Result<std::string> word(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    if (!node.IsScalar()) return error_at(node, std::string(key) + " is not a word");
    return node.Scalar();
  }

  /// A list of numbers: the node itself, or its `data` as OpenCV and ROS write matrices.
  [[nodiscard]] Result<std::vector<double>> numbers(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    const auto data = node.IsMap() ? node["data"] : node;
    if (!data || !data.IsSequence()) {
      return error_at(node, std::string(key) + (node.IsMap() ? " has no list 'data'" : " is not a list"));
    }
    std::vector<double> values;
    for (const auto& item : data) {
      const auto value = item.IsScalar() ? parse_number(item.Scalar()) : std::nullopt;
      if (!value) return error_at(item, std::string(key) + ": not a number");
      values.push_back(*value);
    }
    return values;
  }

  [[nodiscard]] Result<std::vector<double>> numbers(const char* key, size_t count) const {
    auto values = numbers(key);
    if (values && values->size() != count) {
      return error_at(key, std::string(key) + ": " + std::to_string(values->size()) + " numbers, not " +
                               std::to_string(count));
    }
    return values;
  }

 private:
  const File& file_;
  YAML::Node root_;
};

enum class Bend { kRadtan, kEquidistant, kFov, kNone };

/// Distortion after the four linear numbers. `key` holds the coefficients.
Result<CameraParameters> assemble(const Keys& keys, const char* key, Bend bend, CameraParameters parameters,
                                  std::vector<double> bends) {
  if (bend == Bend::kRadtan || bend == Bend::kNone) {
    // The rational model writes its five numbers first; it is ours when the rest is zero.
    while (bends.size() > 5 && bends.back() == 0) bends.pop_back();
    if (bends.size() > 5) {
      return keys.error_at(
          key,
          "more than 5 distortion coefficients; calibrate without the rational, thin prism and tilted "
          "models, or as fisheye: `cairn-track calibrate --model kb4`");
    }
    parameters.model = CameraModel::kPinholeRadtan;
    parameters.values.insert(parameters.values.end(), bends.begin(), bends.end());
    parameters.values.resize(kRadtanValues, 0.0);
    return parameters;
  }
  const size_t count = bend == Bend::kFov ? 1 : kFisheyeBends;
  if (bends.size() != count) {
    return keys.error_at(
        key, std::to_string(bends.size()) + " distortion coefficients, not " + std::to_string(count));
  }
  parameters.model = bend == Bend::kFov ? CameraModel::kFov : CameraModel::kKannalaBrandt;
  parameters.values.insert(parameters.values.end(), bends.begin(), bends.end());
  return parameters;
}

// ---- OpenCV's FileStorage and ROS' camera_info

/// camera_info names its model, OpenCV's own files do not and mean the plumb bob.
Result<Bend> ros_bend(const Keys& keys) {
  if (!keys.has("distortion_model")) return Bend::kRadtan;
  const auto model = keys.word("distortion_model");
  if (!model) return tl::unexpected(model.error());
  if (*model == "plumb_bob" || *model == "rational_polynomial") return Bend::kRadtan;
  if (*model == "equidistant" || *model == "fisheye") return Bend::kEquidistant;
  return keys.error_at("distortion_model", "distortion_model '" + *model +
                                               "' is not read; calibrate with plumb_bob or equidistant");
}

Result<CameraParameters> parse_opencv(const Keys& keys) {
  const auto bend = ros_bend(keys);
  if (!bend) return tl::unexpected(bend.error());
  const auto width = keys.side("image_width");
  if (!width) return tl::unexpected(width.error());
  const auto height = keys.side("image_height");
  if (!height) return tl::unexpected(height.error());
  const auto matrix = keys.numbers("camera_matrix");
  if (!matrix) return tl::unexpected(matrix.error());
  auto bends = keys.numbers("distortion_coefficients");
  if (!bends) return tl::unexpected(bends.error());
  const auto& m = *matrix;
  if (m.size() != 9 || m[1] != 0 || m[3] != 0) {
    return keys.error_at("camera_matrix", "camera_matrix must be 3x3, [fx 0 cx; 0 fy cy; 0 0 1]");
  }
  CameraParameters parameters{CameraModel::kPinholeRadtan, *width, *height, {m[0], m[4], m[2], m[5]}};
  return assemble(keys, "distortion_coefficients", *bend, std::move(parameters), std::move(*bends));
}

// ---- Kalibr's camchain and EuRoC's sensor.yaml

Result<Bend> kalibr_bend(const Keys& keys) {
  const auto model = keys.word("distortion_model");
  if (!model) return tl::unexpected(model.error());
  if (*model == "radtan" || *model == "radial-tangential") return Bend::kRadtan;
  if (*model == "equidistant" || *model == "equi") return Bend::kEquidistant;
  if (*model == "fov") return Bend::kFov;
  if (*model == "none") return Bend::kNone;
  return keys.error_at("distortion_model", "distortion_model '" + *model +
                                               "' is not read; there are radtan, equidistant, fov and none");
}

/// One camera: EuRoC says distortion_coefficients where Kalibr says distortion_coeffs.
Result<CameraParameters> parse_kalibr(const Keys& keys) {
  const auto camera_model = keys.word("camera_model");
  if (!camera_model) return tl::unexpected(camera_model.error());
  if (*camera_model != "pinhole") {
    return keys.error_at("camera_model",
                         "camera_model '" + *camera_model +
                             "' is not read; calibrate with Kalibr's pinhole-radtan or pinhole-equi");
  }
  const auto bend = kalibr_bend(keys);
  if (!bend) return tl::unexpected(bend.error());
  const auto size = keys.numbers("resolution", 2);
  if (!size) return tl::unexpected(size.error());
  auto values = keys.numbers("intrinsics", 4);
  if (!values) return tl::unexpected(values.error());
  const char* bends_key =
      keys.has("distortion_coefficients") ? "distortion_coefficients" : "distortion_coeffs";
  auto bends = *bend == Bend::kNone ? Result<std::vector<double>>{} : keys.numbers(bends_key);
  if (!bends) return tl::unexpected(bends.error());
  const int width = side_from_number((*size)[0]);
  const int height = side_from_number((*size)[1]);
  if (width == 0 || height == 0) {
    return keys.error_at("resolution", "resolution must be two positive whole numbers");
  }
  return assemble(keys, bends_key, *bend, {CameraModel::kPinholeRadtan, width, height, std::move(*values)},
                  std::move(*bends));
}

/// cam0, cam1, ...; OpenCV's camera_matrix is none.
bool names_camera(const YAML::Node& key) {
  constexpr std::string_view kPrefix = "cam";
  if (!key.IsScalar() || !key.Scalar().starts_with(kPrefix)) return false;
  const auto number = std::string_view(key.Scalar()).substr(kPrefix.size());
  return !number.empty() && number.find_first_not_of("0123456789") == std::string_view::npos;
}

/// The keys of a camchain's cameras.
std::vector<std::string> cameras_of(const YAML::Node& root) {
  std::vector<std::string> names;
  for (const auto& entry : root) {
    if (names_camera(entry.first)) names.push_back(entry.first.Scalar());
  }
  return names;
}

/// Which camera's lens is meant cannot be guessed: with another's all would look well and be wrong.
Result<std::string> choose_camera(const File& file, const std::vector<std::string>& names) {
  if (file.camera.empty() && names.size() == 1) return names.front();
  if (std::find(names.begin(), names.end(), file.camera) != names.end()) return std::string(file.camera);
  std::string all;
  for (const auto& name : names) all += (all.empty() ? "" : ", ") + name;
  return wrong(file.path.string() + ": cameras in it: " + all + "; say which with --calibration " +
               file.path.string() + "#" + names.front());
}

Result<CameraParameters> parse_document(const File& file, const YAML::Node& root) {
  if (!root.IsMap()) return wrong(file.path.string() + ": not a calibration; " + std::string(kFormats));
  const Keys keys(file, root);
  if (const auto names = cameras_of(root); !names.empty()) {
    const auto name = choose_camera(file, names);
    if (!name) return tl::unexpected(name.error());
    if (!root[*name].IsMap()) return keys.error_at(name->c_str(), *name + " is not a map of keys");
    return parse_kalibr(Keys(file, root[*name]));
  }
  if (!file.camera.empty()) return names_no_camera(file);
  if (keys.has("intrinsics") || keys.has("camera_model")) return parse_kalibr(keys);
  return parse_opencv(keys);
}

}  // namespace

bool looks_like_yaml(std::string_view content) {
  const auto lines = data_lines(content);
  return !lines.empty() && (lines[0].text.front() == '%' || lines[0].text.starts_with("---") ||
                            lines[0].text.find(':') != std::string::npos);
}

Result<CameraParameters> parse_yaml(const File& file) {
  try {
    return parse_document(file, YAML::Load(file.content));
  } catch (const YAML::Exception& error) {
    const auto line = static_cast<size_t>(std::max(0, error.mark.line) + 1);
    return wrong(at_line(file.path, line, "not YAML: " + error.msg));
  }
}

}  // namespace cairn::calibration
