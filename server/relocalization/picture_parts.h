// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>

#include "common/geometry/camera.h"

namespace cairn {

/// The picture in 4 x 3 parts: what is all about it, and what is in one corner only.
constexpr size_t kPartsAcross = 4;
constexpr size_t kPartsDown = 3;
constexpr size_t kParts = kPartsAcross * kPartsDown;

template <typename T>
using PerPart = std::array<T, kParts>;

/// The part in which a pixel lies; of one outside the picture the nearest.
[[nodiscard]] inline size_t part_of(const Eigen::Vector2f& pixel, const Camera& camera) {
  const auto slice = [](float at, int size, size_t slices) {
    const auto n = static_cast<int>(slices);
    return static_cast<size_t>(std::clamp(static_cast<int>(at) * n / size, 0, n - 1));
  };
  return slice(pixel.y(), camera.height(), kPartsDown) * kPartsAcross +
         slice(pixel.x(), camera.width(), kPartsAcross);
}

}  // namespace cairn
