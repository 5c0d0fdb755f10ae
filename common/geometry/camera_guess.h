// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "common/geometry/camera.h"

namespace cairn {

/// Sigmas of less say that a value is exact, and their squares are no weights to calculate with.
inline constexpr double kLeastPriorSigma = 1e-6;

/// How many values a pinhole-radtan camera has when all are given.
inline constexpr size_t kPriorValues = 9;

/// Whether a camera could have it: 0.1 to 20 times the longer side of its image.
[[nodiscard]] bool is_focal_length(double focal, int width, int height);

/// Whether pixels could have this aspect: their width in heights, fy / fx, from 0.2 to 5.
[[nodiscard]] bool is_pixel_aspect(double aspect);

/// The intrinsics prior: a camera's values and how uncertain they are, from which self-calibration begins.
struct IntrinsicsPrior {
  CameraParameters parameters;  ///< pinhole-radtan, all nine values
  double focal_sigma = 0;       ///< of the focal length, relative to it
  double k1_sigma = 0;
};

/// The standard deviation of each value of the camera, as the wire tells them: 0 for values that are exact.
/// intrinsics_prior() is the way back. Precondition: pinhole-radtan, all nine values.
[[nodiscard]] std::vector<double> sigma_of_values(const IntrinsicsPrior& camera);
/// The prior of a pinhole-radtan camera, from all nine values and one sigma for each. Nothing for another
/// model, when the focal length or k1 is exact (kLeastPriorSigma), or when no camera could have the values
/// (is_focal_length(), is_pixel_aspect(), sigmas up to 1; that of the focal length is relative to it).
[[nodiscard]] std::optional<IntrinsicsPrior> intrinsics_prior(const CameraParameters& parameters,
                                                              const std::vector<double>& sigma);

/// The likely values of a camera of which only the image's size is known: 60 degrees of view along the longer
/// side, square pixels, centre in the middle, no distortion. Sigma 35 %: 0.5 to 1.5 times the longer side
/// within two sigma, from wide-angle to telephoto-ish phones and web cameras.
[[nodiscard]] IntrinsicsPrior guess_camera(ImageSize size);

/// A pinhole calibration without any distortion, believed as the data sheet that it is likely to be from:
/// focal length to 0.5 %, k1 to 0.05. Nothing for a calibration with distortion, and for other models: those
/// were measured.
[[nodiscard]] std::optional<IntrinsicsPrior> nominal_camera(const CameraParameters& parameters);

/// A calibration that is believed roughly: focal length to 3 %, k1 to 0.05. Error (kConfiguration): a model
/// other than pinhole-radtan.
[[nodiscard]] Result<IntrinsicsPrior> rough_prior(const CameraParameters& parameters);

}  // namespace cairn
