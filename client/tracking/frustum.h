// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <numbers>

#include "common/base/simd.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/map/snapshot.h"

namespace cairn {

struct FrustumOptions {
  int rays_per_axis = 17;     ///< of the grid over the image that every side is checked against
  float side_margin = 1e-3F;  ///< [rad] for what bulges between the rays, and for rounding
  float coarse_area = 12.0F;  ///< [level-0 px^2 per source px^2] searched two levels up (warp_level)
  /// Depth over distance, at least: bounds the estimated area at the rim of a fisheye.
  float min_depth_share = 0.5F;
  /// [rad] A point may be seen from this much farther round, and from these factors nearer and farther than
  /// any keyframe has seen it; beyond, its patch is not expected to match.
  double extra_angle = 35.0 * std::numbers::pi / 180;
  float nearer = 0.5F;
  float farther = 2.0F;
  float nearest = 1e-3F;  ///< [map unit] in front of the camera; that of the point search
};

/// The viewing volume of a camera, whatever its model: for each edge of the image the cone n^T p >= m |p|
/// about the plane through that edge, m low enough to hold the edge as the lens bends it. Holds every point
/// that projects into the image, and few others. Immutable.
class Frustum {
 public:
  explicit Frustum(const Camera& camera, const FrustumOptions& options);

  struct Side {
    Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();  ///< unit, camera frame, inwards
    float sine = -1;                                    ///< m: of the angle to the plane, <= 0
  };
  [[nodiscard]] const std::array<Side, 4>& sides() const { return sides_; }
  [[nodiscard]] const FrustumOptions& options() const { return options_; }
  [[nodiscard]] float extra_cosine() const { return extra_cosine_; }  ///< of FrustumOptions::extra_angle
  [[nodiscard]] float extra_sine() const { return extra_sine_; }
  /// Whether a sphere (camera frame, any unit) may reach into the frustum.
  [[nodiscard]] bool may_hold(const Eigen::Vector3f& center, float radius) const;

 private:
  std::array<Side, 4> sides_;
  FrustumOptions options_;
  float extra_cosine_ = 1;
  float extra_sine_ = 0;
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
