// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/result.h"

namespace cairn {

/// Pixel at which an image shows a point of the map, or should.
struct MarkedPoint {
  int x = 0;
  int y = 0;
  bool found = false;
};

/// A grey image (PNG, JPEG) as a coloured PNG, with a green square about each point that was found and a
/// red cross on each that was not. Pure. Error kDamaged: it is no image.
[[nodiscard]] Result<std::vector<uint8_t>> with_points(std::span<const uint8_t> image,
                                                       std::span<const MarkedPoint> points);

}  // namespace cairn
