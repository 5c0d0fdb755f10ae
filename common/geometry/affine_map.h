// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "common/geometry/two_view.h"

namespace cairn {

/// How the image around the matches turned, stretched and sheared from the first view to the second: the
/// linear part of the affine map that fits the better two thirds of them (least trimmed squares, three
/// rounds). Identity for fewer than six matches and for matches on a line. Pure; safe to call from any
/// thread.
[[nodiscard]] Eigen::Matrix2d fit_affine_map(std::span<const PixelMatch> matches);

}  // namespace cairn
