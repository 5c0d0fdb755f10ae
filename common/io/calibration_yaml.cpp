// SPDX-License-Identifier: Apache-2.0
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <optional>

#include "common/io/calibration_keys.h"

namespace cairn::calibration {
namespace {

/// The distortion after the four linear numbers; `key` holds the coefficients.
Result<CameraParameters> assemble(const Keys& keys, const char* key, Distortion distortion,
                                  CameraParameters linear, std::vector<double> coefficients) {
  auto parameters = with_distortion(std::move(linear), distortion, std::move(coefficients));
  if (!parameters) return keys.error_at(key, parameters.error().message);
  return parameters;
}

// ---- OpenCV's FileStorage and ROS' camera_info

/// The names that the four things have: OpenCV's calibration program and ROS' yaml, OpenCV's older program,
/// and what `rostopic echo` and `ros2 topic echo` print of a camera_info.
struct Names {
  const char* width;
  const char* height;
  const char* matrix;
  const char* coefficients;
};
constexpr std::array kNames = {
    Names{"image_width", "image_height", "camera_matrix", "distortion_coefficients"},
    Names{"image_Width", "image_Height", "Camera_Matrix", "Distortion_Coefficients"},
    Names{"width", "height", "K", "D"}, Names{"width", "height", "k", "d"}};

const Names& names_in(const Keys& keys) {
  const auto* at =
      std::find_if(kNames.begin(), kNames.end(), [&](const Names& n) { return keys.has(n.matrix); });
  return at == kNames.end() ? kNames.front() : *at;
}

/// camera_info names its model. OpenCV's own files mean the plumb bob unless they say fisheye.
Result<Distortion> opencv_distortion(const Keys& keys) {
  if (!keys.has("distortion_model")) {
    if (!keys.has("fisheye_model")) return Distortion::kRadtan;
    return keys.number("fisheye_model").map([](double is_fisheye) {
      return is_fisheye != 0 ? Distortion::kEquidistant : Distortion::kRadtan;
    });
  }
  const auto model = keys.word("distortion_model");
  if (!model) return tl::unexpected(model.error());
  if (*model == "plumb_bob" || *model == "rational_polynomial" || model->empty()) return Distortion::kRadtan;
  if (*model == "equidistant" || *model == "fisheye") return Distortion::kEquidistant;
  return keys.error_at("distortion_model", "distortion_model '" + *model +
                                               "' is not read; calibrate with plumb_bob or equidistant");
}

/// A camera_info describes the whole sensor; of images that are binned or cut out of it other numbers hold.
Status check_whole_image(const Keys& keys) {
  const auto roi = keys.below("roi");
  const auto is_above = [](const Keys& in, const char* key, double limit) {
    return in.has(key) && in.number(key).value_or(0) > limit;
  };
  const bool binned = is_above(keys, "binning_x", 1) || is_above(keys, "binning_y", 1);
  const bool cut = is_above(roi, "x_offset", 0) || is_above(roi, "y_offset", 0);
  if (!binned && !cut) return {};
  return keys.error_at(binned ? "binning_x" : "roi",
                       "the calibration is that of the whole sensor, and its images are binned or cut out; "
                       "calibrate with such images: `cairn-track calibrate`");
}

/// Calibrations of others that are told by a key and not read.
struct Foreign {
  const char* key;
  const char* what;
};
constexpr std::array kForeign = {
    Foreign{"M1", "OpenCV's stereo calibration, which has no image size"},
    Foreign{"cameras", "the cameras of OKVIS or SVO"},
    Foreign{"value0", "Basalt's calibration"},
};

tl::unexpected<Error> not_read(const Keys& keys) {
  const auto* const at =
      std::find_if(kForeign.begin(), kForeign.end(), [&](const Foreign& f) { return keys.has(f.key); });
  const std::string remedy =
      "; write its numbers into one line `width height fx fy cx cy [k1 k2 p1 p2 [k3]]`, or as Kalibr's "
      "camchain";
  if (at != kForeign.end()) return keys.error_at(at->key, std::string(at->what) + ", is not read" + remedy);
  return keys.error("no calibration in it: neither camera_matrix nor intrinsics; " + std::string(kFormats));
}

Result<CameraParameters> parse_opencv(const Keys& keys) {
  const Names& names = names_in(keys);
  if (!keys.has(names.matrix) && !keys.has(names.width)) return not_read(keys);
  const auto distortion = opencv_distortion(keys);
  if (!distortion) return tl::unexpected(distortion.error());
  if (const Status whole = check_whole_image(keys); !whole) return tl::unexpected(whole.error());
  const auto width = keys.side(names.width);
  if (!width) return tl::unexpected(width.error());
  const auto height = keys.side(names.height);
  if (!height) return tl::unexpected(height.error());
  const auto matrix = keys.numbers(names.matrix);
  if (!matrix) return tl::unexpected(matrix.error());
  auto coefficients = keys.numbers(names.coefficients);
  if (!coefficients) return tl::unexpected(coefficients.error());
  const auto& m = *matrix;
  if (m.size() != 9 || m[1] != 0 || m[3] != 0) {
    return keys.error_at(names.matrix, std::string(names.matrix) + " must be 3x3, [fx 0 cx; 0 fy cy; 0 0 1]");
  }
  if (m[0] == 0) {
    return keys.error_at(names.matrix, "a camera that nobody has calibrated: " + std::string(names.matrix) +
                                           " is 0; `cairn-track calibrate` makes a calibration");
  }
  CameraParameters linear{CameraModel::kPinholeRadtan, *width, *height, {m[0], m[4], m[2], m[5]}};
  return assemble(keys, names.coefficients, *distortion, std::move(linear), std::move(*coefficients));
}

// ---- Kalibr's camchain and EuRoC's sensor.yaml

Result<Distortion> kalibr_distortion(const Keys& keys) {
  const auto model = keys.word("distortion_model");
  if (!model) return tl::unexpected(model.error());
  if (*model == "radtan" || *model == "radial-tangential") return Distortion::kRadtan;
  if (*model == "equidistant" || *model == "equi") return Distortion::kEquidistant;
  if (*model == "fov") return Distortion::kFov;
  if (*model == "none") return Distortion::kNone;
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
  const auto distortion = kalibr_distortion(keys);
  if (!distortion) return tl::unexpected(distortion.error());
  const auto size = keys.numbers("resolution", 2);
  if (!size) return tl::unexpected(size.error());
  auto values = keys.numbers("intrinsics", 4);
  if (!values) return tl::unexpected(values.error());
  const char* coefficients_key =
      keys.has("distortion_coefficients") ? "distortion_coefficients" : "distortion_coeffs";
  auto coefficients =
      *distortion == Distortion::kNone ? Result<std::vector<double>>{} : keys.numbers(coefficients_key);
  if (!coefficients) return tl::unexpected(coefficients.error());
  const int width = side_from_number((*size)[0]);
  const int height = side_from_number((*size)[1]);
  if (width == 0 || height == 0) {
    return keys.error_at("resolution", "resolution must be two positive whole numbers");
  }
  return assemble(keys, coefficients_key, *distortion,
                  {CameraModel::kPinholeRadtan, width, height, std::move(*values)}, std::move(*coefficients));
}

// ---- VINS-Mono and VINS-Fusion (camodocal)

Result<CameraParameters> parse_vins(const Keys& keys) {
  if (!keys.has("model_type")) {
    const auto named = keys.word("cam0_calib");
    return keys.error_at("cam0_calib", "the settings of VINS-Fusion; pass the file of its camera: " +
                                           in_quotes(named.value_or("cam0_calib")) + " beside it");
  }
  const auto model = keys.word("model_type");
  if (!model) return tl::unexpected(model.error());
  const bool is_pinhole = *model == "PINHOLE";
  if (!is_pinhole && *model != "KANNALA_BRANDT") {
    return keys.error_at("model_type", "model_type " + in_quotes(*model) +
                                           " of VINS is not read; calibrate with PINHOLE or KANNALA_BRANDT, "
                                           "or: `cairn-track calibrate --model kb4`");
  }
  const auto width = keys.side("image_width");
  if (!width) return tl::unexpected(width.error());
  const auto height = keys.side("image_height");
  if (!height) return tl::unexpected(height.error());
  const Keys projection = keys.below("projection_parameters");
  auto linear =
      is_pinhole ? projection.each({"fx", "fy", "cx", "cy"}) : projection.each({"mu", "mv", "u0", "v0"});
  if (!linear) return tl::unexpected(linear.error());
  auto coefficients = is_pinhole ? keys.below("distortion_parameters").each({"k1", "k2", "p1", "p2"})
                                 : projection.each({"k2", "k3", "k4", "k5"});
  if (!coefficients) return tl::unexpected(coefficients.error());
  return assemble(keys, "projection_parameters", is_pinhole ? Distortion::kRadtan : Distortion::kEquidistant,
                  {CameraModel::kPinholeRadtan, *width, *height, std::move(*linear)},
                  std::move(*coefficients));
}

// ---- OpenCV's FileStorage as XML

/// The text between <name ...> and </name>; nothing if the element is not there.
std::optional<std::string_view> element(std::string_view xml, const std::string& name) {
  for (size_t at = xml.find("<" + name); at != std::string_view::npos; at = xml.find("<" + name, at + 1)) {
    const char next = at + 1 + name.size() < xml.size() ? xml[at + 1 + name.size()] : '\0';
    const size_t begin = xml.find('>', at);
    const size_t end = xml.find("</" + name + ">", at);
    if (next != '>' && next != ' ') continue;
    if (begin == std::string_view::npos || end == std::string_view::npos || end < begin) return std::nullopt;
    return xml.substr(begin + 1, end - begin - 1);
  }
  return std::nullopt;
}

/// The elements that a calibration consists of, as the YAML of the same names would be.
YAML::Node opencv_xml(std::string content) {
  std::replace(content.begin(), content.end(), '\n', ' ');
  YAML::Node root(YAML::NodeType::Map);
  const auto take = [&](const std::string& name) {
    const auto inside = element(content, name);
    const auto data = inside ? element(*inside, "data") : std::nullopt;
    if (inside && !data) root[name] = std::string(trim(*inside));
    if (!data) return;
    for (const auto number : split_fields(*data)) root[name]["data"].push_back(std::string(number));
  };
  for (const Names& names : {kNames[0], kNames[1]}) {
    for (const char* name : {names.width, names.height, names.matrix, names.coefficients}) take(name);
  }
  take("fisheye_model");
  return root;
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
  if (keys.has("model_type") || keys.has("cam0_calib")) return parse_vins(keys);
  return parse_opencv(keys);
}

}  // namespace

bool looks_like_xml(std::string_view content) {
  const auto lines = data_lines(content);
  return !lines.empty() && lines[0].text.front() == '<';
}

bool looks_like_yaml(std::string_view content) {
  const auto lines = data_lines(content);
  return !lines.empty() && (lines[0].text.front() == '%' || lines[0].text.starts_with("---") ||
                            lines[0].text.find(':') != std::string::npos);
}

Result<CameraParameters> parse_xml(const File& file) {
  if (!file.camera.empty()) return names_no_camera(file);
  const YAML::Node root = opencv_xml(file.content);
  const Keys keys(file, root);
  if (keys.has(kNames[0].matrix) || keys.has(kNames[1].matrix)) return parse_opencv(keys);
  return wrong(file.path.string() + ": XML without the camera_matrix of OpenCV; " + std::string(kFormats));
}

Result<CameraParameters> parse_yaml(const File& file) {
  try {
    return parse_document(file, YAML::Load(file.content));  // the first of several: `ros2 topic echo`
  } catch (const YAML::Exception& error) {
    const auto line = static_cast<size_t>(std::max(0, error.mark.line) + 1);
    return wrong(at_line(file.path, line, "not YAML: " + error.msg));
  }
}

}  // namespace cairn::calibration
