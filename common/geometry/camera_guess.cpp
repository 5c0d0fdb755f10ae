// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera_guess.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr size_t kK1 = 4;  // of the values
constexpr double kUsualHalfView = 30 * std::numbers::pi / 180;
constexpr double kUnknownFocal = 0.35;
constexpr double kUnknownK1 = 0.1;  // ordinary lenses lie within two of it; wide-angle ones beyond
constexpr double kRoughFocal = 0.03;
constexpr double kRoughK1 = 0.05;
constexpr double kNominalFocal = 0.005;

}  // namespace

bool is_focal_length(double focal, int width, int height) {
  const double sides = focal / std::max(width, height);
  return sides >= 0.1 && sides <= 20;
}

bool is_pixel_aspect(double aspect) {
  return aspect >= 0.2 && aspect <= 5;
}

std::vector<double> sigma_of_values(const IntrinsicsPrior& camera) {
  std::vector<double> sigma(camera.parameters.values.size(), 0.0);
  for (const size_t focal : {0, 1}) sigma[focal] = camera.focal_sigma * camera.parameters.values[focal];
  sigma[kK1] = camera.k1_sigma;
  return sigma;
}

std::optional<IntrinsicsPrior> intrinsics_prior(const CameraParameters& parameters,
                                                const std::vector<double>& sigma) {
  if (parameters.model != CameraModel::kPinholeRadtan || parameters.values.size() != kPriorValues ||
      sigma.size() != kPriorValues)
    return std::nullopt;
  const double focal = parameters.values[0];
  const double focal_sigma = sigma[0] / focal;
  const double aspect = parameters.values[1] / focal;
  const auto lies = [](double value, double least, double most) { return value >= least && value <= most; };
  constexpr double kRounding = 1e-9;  // of a sigma that went through a product with the focal length
  const bool sound = is_focal_length(focal, parameters.width, parameters.height) && is_pixel_aspect(aspect) &&
                     lies(focal_sigma, kLeastPriorSigma * (1 - kRounding), 1 + kRounding) &&
                     lies(sigma[kK1], kLeastPriorSigma, 1);
  if (!sound) return std::nullopt;
  return IntrinsicsPrior{parameters, focal_sigma, sigma[kK1]};
}

IntrinsicsPrior guess_camera(ImageSize size) {
  const double focal = 0.5 * std::max(size.width, size.height) / std::tan(kUsualHalfView);
  IntrinsicsPrior guess;
  guess.parameters = {CameraModel::kPinholeRadtan,
                      size.width,
                      size.height,
                      {focal, focal, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0, 0, 0, 0, 0}};
  guess.focal_sigma = kUnknownFocal;
  guess.k1_sigma = kUnknownK1;
  return guess;
}

std::optional<IntrinsicsPrior> nominal_camera(const CameraParameters& parameters) {
  const auto distorts = [](double value) { return value != 0; };
  if (parameters.model != CameraModel::kPinholeRadtan ||
      std::any_of(parameters.values.begin() + kK1, parameters.values.end(), distorts))
    return std::nullopt;
  IntrinsicsPrior nominal{parameters, kNominalFocal, kRoughK1};
  nominal.parameters.values.resize(kPriorValues, 0.0);
  return nominal;
}

Result<IntrinsicsPrior> rough_prior(const CameraParameters& parameters) {
  if (parameters.model != CameraModel::kPinholeRadtan) {
    return fail(ErrorCode::kConfiguration, "a " + std::string(name_of(parameters.model)) +
                                               " camera is taken as it is: what is calibrated while tracking "
                                               "is the focal length and k1 of pinhole-radtan");
  }
  IntrinsicsPrior prior{parameters, kRoughFocal, kRoughK1};
  prior.parameters.values.resize(kPriorValues, 0.0);
  return prior;
}

}  // namespace cairn
