// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <variant>

#include "common/base/result.h"

namespace cairn {

/// An axis-aligned box in the map frame [map unit].
struct Box {
  Eigen::Vector3d min = Eigen::Vector3d::Zero();
  Eigen::Vector3d max = Eigen::Vector3d::Zero();
  bool operator==(const Box&) const = default;
};

/// A ball in the map frame [map unit].
struct Sphere {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0;
  bool operator==(const Sphere&) const = default;
};

/// The part of a map in which somebody may let it grow: cameras and points outside are not taken in.
using Extent = std::variant<Box, Sphere>;

/// Whether `place` lies inside or on the border; false for what is not finite.
[[nodiscard]] bool contains(const Extent& extent, const Eigen::Vector3d& place);

/// Checks an extent. Error kUsage, with what is wrong: a number that is not finite, a box whose corners are
/// the wrong way round or that has no inside, a radius that is not positive.
[[nodiscard]] Status check(const Extent& extent);

/// An extent in words for a person: "box -1.00 0.00 -1.00 to 2.00 1.50 1.00" or "2.00 around 0.00 1.00 0.00".
[[nodiscard]] std::string describe(const Extent& extent);

/// Why something ("its camera") may not be there, for a person.
[[nodiscard]] std::string outside(const Extent& extent, std::string_view what, const Eigen::Vector3d& place);

/// The box, with room on each side [map unit].
[[nodiscard]] Box with_margin(Box bounds, double margin);

}  // namespace cairn
