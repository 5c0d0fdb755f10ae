// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "common/image/image.h"

namespace cairn {

/// Corners of a square [px], in order around it.
using TagCorners = std::array<Eigen::Vector2d, 4>;

/// The corners of a dark square on light ground, to a fraction of a pixel: each side is fitted to its edge in
/// the image, as a parabola (a lens bends it), and the sides are intersected. Blur rounds corners off and
/// leaves the sides where they are. `modules`: bits across the square, its border included; neither the
/// pattern inside nor what lies beside the square may be nearer to a side than one of them. `corners` may be
/// off by a module, at most 3 px. Nothing where a side is not seen. Pure; safe to call from any thread.
[[nodiscard]] std::optional<TagCorners> refine_tag_corners(const GrayView& image, const TagCorners& corners,
                                                           int modules);

}  // namespace cairn
