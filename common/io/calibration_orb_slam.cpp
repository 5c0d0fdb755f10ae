// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "common/io/calibration_formats.h"

namespace cairn::calibration {
namespace {

constexpr std::string_view kPrefixes[] = {"Camera", "Camera1", "Camera2"};

/// The lines `Camera....: value`, by their keys. Comments and quotes are left out.
class Settings {
 public:
  explicit Settings(const File& file) : file_(file) {
    for (const TextLine& line : data_lines(file.content)) {
      const size_t colon = line.text.find(':');
      if (!line.text.starts_with("Camera") || colon == std::string_view::npos) continue;
      auto value = trim(line.text.substr(colon + 1));
      value = trim(value.substr(0, value.find('#')));
      if (value.size() >= 2 && value.front() == '"' && value.back() == '"')
        value = value.substr(1, value.size() - 2);
      lines_[std::string(trim(line.text.substr(0, colon)))] = {line.number, value};
    }
  }
  [[nodiscard]] bool has(const std::string& key) const { return lines_.contains(key); }
  [[nodiscard]] std::string_view word(const std::string& key) const {
    const auto at = lines_.find(key);
    return at == lines_.end() ? std::string_view() : at->second.text;
  }
  /// The numbers under PREFIX.NAME for each name; kConfiguration where one is missing or none.
  [[nodiscard]] Result<std::vector<double>> numbers(const std::string& prefix,
                                                    std::initializer_list<const char*> names) const {
    std::vector<double> values;
    for (const char* name : names) {
      const std::string key = prefix + "." + name;
      const auto at = lines_.find(key);
      if (at == lines_.end())
        return wrong(file_.path.string() + ": no '" + key + "' in these settings of ORB-SLAM");
      const auto value = parse_number(at->second.text);
      if (!value) return wrong(at_line(file_.path, at->second.number, key + " is not a number"));
      values.push_back(*value);
    }
    return values;
  }
  [[nodiscard]] tl::unexpected<Error> error_at(const std::string& key, const std::string& message) const {
    return wrong(at_line(file_.path, lines_.at(key).number, message));
  }

 private:
  const File& file_;
  std::map<std::string, TextLine> lines_;
};

/// ORB-SLAM2 need not say its image size: then it is the source's.
Result<ImageSize> size_of(const File& file, const Settings& settings) {
  if (settings.has("Camera.width") && settings.has("Camera.height")) {
    const auto sides = settings.numbers("Camera", {"width", "height"});
    if (!sides) return tl::unexpected(sides.error());
    const ImageSize size{side_from_number((*sides)[0]), side_from_number((*sides)[1])};
    if (size.width != 0 && size.height != 0) return size;
    return settings.error_at("Camera.width", "Camera.width and Camera.height must be positive whole numbers");
  }
  if (file.image_size) return *file.image_size;
  return wrong(
      file.path.string() +
      ": settings of ORB-SLAM without Camera.width and Camera.height, and the source does not tell its "
      "size; add them");
}

Result<std::vector<double>> coefficients_of(const Settings& settings, const std::string& camera,
                                            Distortion distortion) {
  if (distortion == Distortion::kNone) return {};
  if (distortion == Distortion::kEquidistant) return settings.numbers(camera, {"k1", "k2", "k3", "k4"});
  if (!settings.has(camera + ".k1")) return {};  // as ORB-SLAM has it: no distortion
  if (settings.has(camera + ".k3")) return settings.numbers(camera, {"k1", "k2", "p1", "p2", "k3"});
  return settings.numbers(camera, {"k1", "k2", "p1", "p2"});
}

}  // namespace

bool looks_like_orb_slam(std::string_view content) {
  const auto lines = data_lines(content);
  return std::any_of(lines.begin(), lines.end(), [](const TextLine& line) {
    return std::any_of(std::begin(kPrefixes), std::end(kPrefixes), [&](std::string_view prefix) {
      return line.text.starts_with(prefix) && line.text.substr(prefix.size()).starts_with(".fx");
    });
  });
}

Result<CameraParameters> parse_orb_slam(const File& file) {
  const Settings settings(file);
  std::vector<std::string> cameras;
  for (const auto prefix : kPrefixes) {
    if (settings.has(std::string(prefix) + ".fx")) cameras.emplace_back(prefix);
  }
  const auto camera = choose_camera(file, cameras);
  if (!camera) return tl::unexpected(camera.error());
  const std::string_view type = settings.word("Camera.type");
  const bool is_pinhole = type.empty() || type == "PinHole" || type == "Rectified";
  if (!is_pinhole && type != "KannalaBrandt8") {
    return settings.error_at("Camera.type", "Camera.type " + in_quotes(type) +
                                                " of ORB-SLAM is not read; there are PinHole, Rectified and "
                                                "KannalaBrandt8");
  }
  const Distortion distortion = type == "Rectified" ? Distortion::kNone
                                : is_pinhole        ? Distortion::kRadtan
                                                    : Distortion::kEquidistant;
  const auto size = size_of(file, settings);
  if (!size) return tl::unexpected(size.error());
  auto linear = settings.numbers(*camera, {"fx", "fy", "cx", "cy"});
  if (!linear) return tl::unexpected(linear.error());
  auto coefficients = coefficients_of(settings, *camera, distortion);
  if (!coefficients) return tl::unexpected(coefficients.error());
  return with_distortion({CameraModel::kPinholeRadtan, size->width, size->height, std::move(*linear)},
                         distortion, std::move(*coefficients));
}

}  // namespace cairn::calibration
