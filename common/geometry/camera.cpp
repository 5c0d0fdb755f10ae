// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/geometry/camera_models.h"

namespace cairn {
namespace {

struct ModelTraits {
  CameraModel model;
  std::string_view name;
  size_t min_values;
  size_t max_values;
  std::string_view order;
  CameraPtr (*make)(const CameraParameters&);
  /// What is wrong with values whose number, finiteness and focal lengths are right; empty: nothing.
  std::string (*fault)(const std::vector<double>& values);
};

std::string no_fault(const std::vector<double>&) {
  return {};
}

std::string fault_of_fov(const std::vector<double>& values) {
  const double w = values[4];
  if (w >= 0 && w < std::numbers::pi) return {};
  return "fov's w = " + std::to_string(w) + " is not an angle from 0 to below pi [rad]";
}

constexpr std::array kModels = {
    ModelTraits{CameraModel::kPinholeRadtan, "pinhole-radtan", 4, 9, "fx fy cx cy [k1 k2 p1 p2 k3]",
                make_pinhole_radtan, no_fault},
    ModelTraits{CameraModel::kKannalaBrandt, "kb4", 4, 8, "fx fy cx cy [k1 k2 k3 k4]", make_kannala_brandt,
                no_fault},
    ModelTraits{CameraModel::kFov, "fov", 5, 5, "fx fy cx cy w", make_fov, fault_of_fov},
};

const ModelTraits* find(CameraModel model) {
  const auto at =
      std::find_if(kModels.begin(), kModels.end(), [&](const auto& m) { return m.model == model; });
  return at == kModels.end() ? nullptr : &*at;
}

tl::unexpected<Error> wrong(const std::string& what) {
  return fail(ErrorCode::kConfiguration, "camera: " + what);
}

std::string known_models() {
  std::string names;
  for (const auto& m : kModels) {
    names +=
        (names.empty() ? "" : ", ") + std::to_string(static_cast<int>(m.model)) + " " + std::string(m.name);
  }
  return names;
}

}  // namespace

bool is_camera_model(int number) {
  return std::any_of(kModels.begin(), kModels.end(),
                     [&](const auto& m) { return static_cast<int>(m.model) == number; });
}

std::vector<CameraModel> camera_models() {
  std::vector<CameraModel> models;
  for (const auto& m : kModels) models.push_back(m.model);
  return models;
}

std::string_view name_of(CameraModel model) {
  const auto* traits = find(model);
  return traits == nullptr ? "unknown" : traits->name;
}

Result<CameraPtr> make_camera(const CameraParameters& parameters) {
  const auto& v = parameters.values;
  const auto* traits = find(parameters.model);
  if (traits == nullptr) {
    return wrong("unknown model " + std::to_string(static_cast<int>(parameters.model)) +
                 "; known: " + known_models());
  }
  if (parameters.width <= 0 || parameters.height <= 0) {
    return wrong("image size " + std::to_string(parameters.width) + "x" + std::to_string(parameters.height) +
                 " is not positive");
  }
  if (v.size() < traits->min_values || v.size() > traits->max_values) {
    return wrong(std::to_string(v.size()) + " parameters; " + std::string(traits->name) +
                 " has: " + std::string(traits->order));
  }
  if (!std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); })) {
    return wrong("a parameter is not a finite number");
  }
  if (v[0] <= 0 || v[1] <= 0) {
    return wrong("focal length " + std::to_string(std::min(v[0], v[1])) + " is not positive");
  }
  if (const std::string fault = traits->fault(v); !fault.empty()) return wrong(fault);
  return traits->make(parameters);
}

}  // namespace cairn
