// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>

#include "common/geometry/camera.h"

namespace cairn {

/// Grid of 4 x 3 cells over the image, to tell what is all over it from what is in one corner only.
constexpr size_t kCellsAcross = 4;
constexpr size_t kCellsDown = 3;
constexpr size_t kImageCells = kCellsAcross * kCellsDown;

template <typename T>
using PerCell = std::array<T, kImageCells>;

/// The cell in which a pixel lies; of one outside the image the nearest.
[[nodiscard]] inline size_t image_cell_of(const Eigen::Vector2f& pixel, const Camera& camera) {
  const auto slice = [](float at, int size, size_t slices) {
    const auto n = static_cast<int>(slices);
    return static_cast<size_t>(std::clamp(static_cast<int>(at) * n / size, 0, n - 1));
  };
  return slice(pixel.y(), camera.height(), kCellsDown) * kCellsAcross +
         slice(pixel.x(), camera.width(), kCellsAcross);
}

}  // namespace cairn
