// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "common/image/image.h"

namespace cairn {

/// What a small image shows at a pixel.
struct Brightness {
  float grey = 0;   ///< level
  float local = 0;  ///< how much brighter that is than the 40 px around it, in units of the contrast there
};

/// `level0`: pixel of the full picture; `small`: its pyramid level 3. Nothing outside of it.
[[nodiscard]] std::optional<Brightness> brightness_at(const GrayView& small, const Eigen::Vector2f& level0);

}  // namespace cairn
