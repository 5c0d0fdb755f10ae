// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <Eigen/Core>
#include <string>

namespace cairn {

/// A box in the map frame [map unit] in which somebody may let a map grow.
struct Extent {
  Eigen::Vector3d min = Eigen::Vector3d::Zero();
  Eigen::Vector3d max = Eigen::Vector3d::Zero();

  /// False for what is not finite.
  [[nodiscard]] bool contains(const Eigen::Vector3d& place) const {
    return (place.array() >= min.array()).all() && (place.array() <= max.array()).all();
  }
};

[[nodiscard]] inline std::string describe(const Extent& extent) {
  return fmt::format("{:.2f} {:.2f} {:.2f} to {:.2f} {:.2f} {:.2f}", extent.min.x(), extent.min.y(),
                     extent.min.z(), extent.max.x(), extent.max.y(), extent.max.z());
}

/// Why a camera may not stand there, for a person.
[[nodiscard]] inline std::string outside(const Extent& extent, const Eigen::Vector3d& camera) {
  return fmt::format(
      "its camera, at {:.2f} {:.2f} {:.2f}, is outside of where this client may let the map grow, {}",
      camera.x(), camera.y(), camera.z(), describe(extent));
}

}  // namespace cairn
