// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration_formats.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cairn::calibration {
namespace {

struct ModelOfDistortion {
  CameraModel model;
  size_t coefficients;
};

ModelOfDistortion model_of(Distortion distortion) {
  switch (distortion) {
    case Distortion::kRadtan:
    case Distortion::kNone:
      break;
    case Distortion::kEquidistant:
      return {CameraModel::kKannalaBrandt, 4};
    case Distortion::kFov:
      return {CameraModel::kFov, 1};
  }
  return {CameraModel::kPinholeRadtan, 5};
}

}  // namespace

tl::unexpected<Error> wrong(std::string message) {
  return fail(ErrorCode::kConfiguration, std::move(message));
}

tl::unexpected<Error> names_no_camera(const File& file) {
  return wrong(file.path.string() + ": no camera '" + std::string(file.camera) +
               "' in it; only the files of Kalibr, ORB-SLAM, COLMAP and KITTI name theirs");
}

/// Which camera's lens is meant cannot be guessed: with another's all would look well and be wrong.
Result<std::string> choose_camera(const File& file, const std::vector<std::string>& names) {
  if (names.empty()) return wrong(file.path.string() + ": it names no camera; " + std::string(kFormats));
  if (file.camera.empty() && names.size() == 1) return names.front();
  if (std::find(names.begin(), names.end(), file.camera) != names.end()) return std::string(file.camera);
  constexpr size_t kMostListed = 8;
  std::string all;
  for (size_t i = 0; i < std::min(names.size(), kMostListed); ++i) all += (i == 0 ? "" : ", ") + names[i];
  if (names.size() > kMostListed) all += ", ...";
  return wrong(file.path.string() + ": cameras in it: " + all + "; say which with --calibration " +
               file.path.string() + "#" + names.front());
}

int side_from_number(double value) {
  if (!(value >= 1) || value > std::numeric_limits<int>::max() || value != std::floor(value)) return 0;
  return static_cast<int>(value);
}

std::optional<std::vector<double>> numbers_in(const std::vector<std::string_view>& fields) {
  std::vector<double> numbers;
  for (const auto field : fields) {
    const auto number = parse_number(field);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

Result<CameraParameters> with_distortion(CameraParameters linear, Distortion distortion,
                                         std::vector<double> coefficients) {
  const auto [model, count] = model_of(distortion);
  const bool is_radtan = model == CameraModel::kPinholeRadtan;
  // The rational model writes its five numbers first; a fisheye of ROS has a fifth, which is 0.
  while (coefficients.size() > count && coefficients.back() == 0) coefficients.pop_back();
  if (is_radtan && coefficients.size() > count) {
    return wrong(
        "more than 5 distortion coefficients; calibrate without the rational, thin prism and tilted models, "
        "or as fisheye: `cairn-track calibrate --model kb4`");
  }
  if (!is_radtan && coefficients.size() != count) {
    return wrong(std::to_string(coefficients.size()) + " distortion coefficients, not " +
                 std::to_string(count));
  }
  linear.values.insert(linear.values.end(), coefficients.begin(), coefficients.end());
  if (is_radtan) linear.values.resize(kRadtanValues, 0.0);
  linear.model = model;
  return linear;
}

CameraParameters in_pixels(ImageSize size, const std::vector<double>& v) {
  return {CameraModel::kPinholeRadtan,
          size.width,
          size.height,
          {v[0] * size.width, v[1] * size.height, v[2] * size.width - 0.5, v[3] * size.height - 0.5}};
}

}  // namespace cairn::calibration
