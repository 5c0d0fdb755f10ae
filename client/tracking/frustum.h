// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "common/base/simd.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/map/snapshot.h"

namespace cairn {

/// What a camera may see, whatever its model: for each edge of the image the cone n^T p >= m |p| about the
/// plane through that edge, m low enough to hold the edge as the lens bends it. Holds every point that
/// projects into the image, and few others. Immutable.
class Frustum {
 public:
  explicit Frustum(const Camera& camera);

  struct Side {
    Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();  ///< unit, camera frame, inwards
    float sine = -1;                                    ///< m: of the angle to the plane, <= 0
  };
  [[nodiscard]] const std::array<Side, 4>& sides() const { return sides_; }
  /// Whether a sphere (camera frame, any unit) reaches into it.
  [[nodiscard]] bool may_hold(const Eigen::Vector3f& center, float radius) const;

 private:
  std::array<Side, 4> sides_;
};

/// The points of a block that a camera may see.
struct BlockView {
  uint64_t slots = 0;  ///< bit s: live, in the frustum, seen from a side and distance it can be seen from
  /// Bit s: will be searched on the levels of the coarse stage, estimated by a pinhole's geometry (the area
  /// on which one source-level pixel falls). Set for all slots.
  uint64_t coarse = 0;
};

/// Tests all points of a block at once, without their patches or the camera model; what passes is to be
/// projected. No lane depends on another: the same bytes whatever the vector width.
[[nodiscard]] BlockView view_block(const PointBlock& block, const Frustum& frustum,
                                   const SE3& camera_from_map, float focal_length);

namespace kernels {
/// The variants, for comparison.
[[nodiscard]] BlockView view_block(const PointBlock& block, const Frustum& frustum,
                                   const SE3& camera_from_map, float focal_length, Simd simd);
}  // namespace kernels

}  // namespace cairn
