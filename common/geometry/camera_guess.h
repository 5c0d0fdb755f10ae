// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "common/geometry/camera.h"

namespace cairn {

/// A camera and how far its values are believed.
struct DoubtfulCamera {
  CameraParameters parameters;  ///< pinhole-radtan
  double focal_sigma = 0;       ///< of the focal length, relative to it
  double k1_sigma = 0;
};

/// One per value, 0 for those that are believed; and back. What the wire says of it.
[[nodiscard]] std::vector<double> sigma_of_values(const DoubtfulCamera& camera);
/// `sigma`: one per value. Nothing when all values are exact, or the model is another.
[[nodiscard]] std::optional<DoubtfulCamera> doubtful_camera(const CameraParameters& parameters,
                                                            const std::vector<double>& sigma);

/// What a camera of which only the picture's size is known is likely to be: 60 degrees of view along the
/// longer side, square pixels, centre in the middle, no distortion. Sigma 35 %: 0.5 to 1.5 times the longer
/// side within two sigma, from wide-angle to telephoto-ish phones and web cameras.
[[nodiscard]] DoubtfulCamera guess_camera(PictureSize size);

/// A calibration that is believed roughly: focal length to 3 %, k1 to 0.05. Error (kConfiguration): a model
/// other than pinhole-radtan.
[[nodiscard]] Result<DoubtfulCamera> doubt_camera(const CameraParameters& parameters);

}  // namespace cairn
