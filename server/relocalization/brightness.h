// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "common/image/image.h"

namespace cairn {

/// How much brighter a small image is at a pixel than the 40 px around it, in units of the contrast there:
/// indifferent to what changes slowly across the picture and to gain, and nearly to any curve of grey levels,
/// which is straight over so few of them. `level0`: pixel of the full picture; `small`: its pyramid level 3.
/// Nothing outside of it, and where all of that is clipped to white or black: what is there does not show.
[[nodiscard]] std::optional<float> local_brightness(const GrayView& small, const Eigen::Vector2f& level0);

}  // namespace cairn
