// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera_guess.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr double kUsualHalfView = 30 * std::numbers::pi / 180;
constexpr double kUnknownFocal = 0.35;
constexpr double kUnknownK1 = 0.2;  // barrel of a cheap wide lens to pincushion of a long one
constexpr double kRoughFocal = 0.03;
constexpr double kRoughK1 = 0.05;

}  // namespace

DoubtfulCamera guess_camera(PictureSize size) {
  const double focal = 0.5 * std::max(size.width, size.height) / std::tan(kUsualHalfView);
  DoubtfulCamera guess;
  guess.parameters = {CameraModel::kPinholeRadtan,
                      size.width,
                      size.height,
                      {focal, focal, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0, 0, 0, 0, 0}};
  guess.focal_sigma = kUnknownFocal;
  guess.k1_sigma = kUnknownK1;
  return guess;
}

Result<DoubtfulCamera> doubt_camera(const CameraParameters& parameters) {
  if (parameters.model != CameraModel::kPinholeRadtan) {
    return fail(ErrorCode::kConfiguration, "a " + std::string(name_of(parameters.model)) +
                                               " camera is taken as it is: what is found out while tracking "
                                               "is the focal length and k1 of pinhole-radtan");
  }
  return DoubtfulCamera{parameters, kRoughFocal, kRoughK1};
}

}  // namespace cairn
