// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/up_direction.h"
#include "common/image/descriptor.h"
#include "common/image/pyramid.h"
#include "common/image/tiny_image.h"

namespace cairn {

/// A corner as it is described to find a place again.
struct PlaceCorner {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px (distorted, as seen)
  uint8_t level = 0;
  Descriptor descriptor{};
};

/// What a camera tells about an image so that a server can say where it was taken: its coarsest pyramid level
/// (80x60 of 640x480; the tiny image of any blur is made from it) and its best corners. About 35 kB.
struct PlaceView {
  GrayImage small;  ///< pyramid level 3
  std::vector<PlaceCorner> corners;
  std::optional<UpDirection> up = {};  ///< in the camera's axes; nothing: not known
};

/// Corners described at most, by level. Coarse ones are few and stand motion blur.
constexpr std::array<int, kPyramidLevels> kPlaceCorners = {450, 250, 120, 60};

/// Describes an image whose FAST corners (thresholds of PTAM r114) have been found. The strongest corners
/// (Shi-Tomasi) of each cell of a grid are taken, so that one busy corner of the view does not use up all;
/// their order does not depend on the gain. Deterministic.
[[nodiscard]] PlaceView describe_place(const Pyramid& pyramid,
                                       const std::array<CornerList, kPyramidLevels>& corners);

}  // namespace cairn
