// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "common/image/image.h"

namespace cairn {

/// Brightness of a small image (pyramid level 3) at a pixel.
struct Brightness {
  /// How much brighter it is than the 40 px around it, in units of the contrast there: indifferent to what
  /// changes slowly across the image and to gain, and nearly to any curve of grey levels, which is straight
  /// over so few of them. The 40 px, and the 3 grey levels that are added to the contrast against noise, are
  /// chosen, not measured.
  float local = 0;
  uint8_t grey = 0;  ///< level: how bright it is
};

/// Brightness at a pixel. `level0`: pixel of the full image; `small`: its pyramid level 3. Nothing outside of
/// the image, and where all of the 40 px around the pixel are clipped to white or black: what is there does
/// not show.
[[nodiscard]] std::optional<Brightness> brightness_at(const GrayView& small, const Eigen::Vector2f& level0);

/// Share of a small image (pyramid level 3) that is clipped to white.
[[nodiscard]] float white_share(const GrayView& small);

}  // namespace cairn
