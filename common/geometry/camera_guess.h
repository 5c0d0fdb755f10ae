// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "common/geometry/camera.h"

namespace cairn {

/// Sigmas of less say that a value is exact, and their squares are no weights to calculate with.
inline constexpr double kLeastPriorSigma = 1e-6;

/// Of pinhole-radtan.
inline constexpr size_t kPriorValues = 9;

/// Whether a camera could have it: 0.1 to 20 times the longer side of its image.
[[nodiscard]] bool is_focal_length(double focal, int width, int height);

/// Whether pixels could be so: their width in heights, fy / fx, from 0.2 to 5.
[[nodiscard]] bool is_pixel_aspect(double aspect);

/// The intrinsics prior: a camera's values and how uncertain they are, from which self-calibration begins.
struct IntrinsicsPrior {
  CameraParameters parameters;  ///< pinhole-radtan, all nine values
  double focal_sigma = 0;       ///< of the focal length, relative to it
  double k1_sigma = 0;
};

/// One per value, 0 for those that are exact; and back. What the wire says of it. Precondition:
/// pinhole-radtan, all nine values.
[[nodiscard]] std::vector<double> sigma_of_values(const IntrinsicsPrior& camera);
/// `sigma`: one per value. Nothing when all values are exact, when the model is another, or when they are
/// none that a camera could have (focal length 0.1 to 20 times the longer side, nearly square pixels, sigmas
/// up to 1).
[[nodiscard]] std::optional<IntrinsicsPrior> intrinsics_prior(const CameraParameters& parameters,
                                                              const std::vector<double>& sigma);

/// What a camera of which only the image's size is known is likely to be: 60 degrees of view along the
/// longer side, square pixels, centre in the middle, no distortion. Sigma 35 %: 0.5 to 1.5 times the longer
/// side within two sigma, from wide-angle to telephoto-ish phones and web cameras.
[[nodiscard]] IntrinsicsPrior guess_camera(ImageSize size);

/// A pinhole calibration without any distortion, believed as the data sheet that it is likely to be from:
/// focal length to 0.5 %, k1 to 0.05. Nothing for a calibration with distortion, and for other models: those
/// were measured.
[[nodiscard]] std::optional<IntrinsicsPrior> nominal_camera(const CameraParameters& parameters);

/// A calibration that is believed roughly: focal length to 3 %, k1 to 0.05. Error (kConfiguration): a model
/// other than pinhole-radtan.
[[nodiscard]] Result<IntrinsicsPrior> rough_prior(const CameraParameters& parameters);

}  // namespace cairn
