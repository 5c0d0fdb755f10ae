// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/map/snapshot.h"

namespace cairn::test {

struct View {
  SE3 camera_from_map;
  float mean_depth = 1;
  std::optional<Eigen::Vector3d> normal = {};  ///< of the surface, map frame; none: it faces the camera
};

/// A map made without a map maker: keyframe 1 at `view`, with a point for every candidate corner of every
/// level of its `image`. `where`: the place of what lies on a unit ray of the camera, map frame.
[[nodiscard]] MapSnapshotPtr map_of_view(
    const Camera& camera, const GrayView& image, const View& view,
    const std::function<Eigen::Vector3d(const Eigen::Vector3d& ray)>& where);

}  // namespace cairn::test
