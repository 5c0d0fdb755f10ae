// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/geometry/camera.h"

namespace cairn {

// The models behind make_camera(), which has checked the parameters: their number, finiteness, focal lengths
// and size.

[[nodiscard]] CameraPtr make_pinhole_radtan(const CameraParameters& parameters);
/// Kannala and Brandt, "A Generic Camera Model and Calibration Method ..." (PAMI 2006), eq. 6 with four odd
/// terms.
[[nodiscard]] CameraPtr make_kannala_brandt(const CameraParameters& parameters);
/// Devernay and Faugeras, "Straight lines have to be straight" (MVA 2001), eq. 13; needs 0 <= w < pi.
[[nodiscard]] CameraPtr make_fov(const CameraParameters& parameters);

}  // namespace cairn
