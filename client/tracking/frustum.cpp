// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/frustum.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr int kRaysPerAxis = 17;        // of the grid over the image that every side is checked against
constexpr float kSideMargin = 1e-3F;    // [rad] for what bulges between the rays, and for rounding
constexpr float kNearest = 1e-3F;       // PTAM r114: in front of the camera [map unit]
constexpr float kCoarseArea = 12.0F;    // [level-0 px^2 per source px^2] searched two levels up (warp_level)
constexpr float kMinDepthShare = 0.5F;  // of the distance: bounds the estimated area at the rim of a fisheye
/// A point may be seen from this much farther round, nearer and farther than any keyframe has seen it;
/// beyond, its patch is not expected to match. 35 degrees, factors of 2.
constexpr float kExtraAngleCosine = 0.81915204F;
constexpr float kExtraAngleSine = 0.57357644F;
constexpr float kNearer = 0.5F;
constexpr float kFarther = 2.0F;

Eigen::Vector3d grid_ray(const Camera& camera, int column, int row) {
  const double step = 1.0 / (kRaysPerAxis - 1);
  return camera.unproject({column * step * (camera.width() - 1), row * step * (camera.height() - 1)});
}

/// One int for each slot of a block: what a vectorized loop compares into.
using Lanes = std::array<int32_t, kBlockSlots>;

uint64_t bits_of(const Lanes& lanes) {
  uint64_t bits = 0;
  for (size_t s = 0; s < lanes.size(); s += 4) {
    bits |= uint64_t{lane_bits(load_lanes<I32x4>(lanes.data() + s) << 31)} << s;
  }
  return bits;
}

/// x |x| grows with x: a >= b * distance is signed_square(a) >= signed_square(b) * distance^2, without a
/// root.
CAIRN_INLINE float signed_square(float x) {
  return x * std::abs(x);
}

}  // namespace

Frustum::Frustum(const Camera& camera) {
  constexpr int kLast = kRaysPerAxis - 1;
  constexpr std::array<std::array<int, 2>, 4> kCorners = {{{0, 0}, {kLast, 0}, {kLast, kLast}, {0, kLast}}};
  const Eigen::Vector3d middle = grid_ray(camera, kLast / 2, kLast / 2);
  for (size_t i = 0; i < sides_.size(); ++i) {
    const auto& from = kCorners[i];
    const auto& to = kCorners[(i + 1) % kCorners.size()];
    Eigen::Vector3d normal =
        grid_ray(camera, from[0], from[1]).cross(grid_ray(camera, to[0], to[1])).normalized();
    if (normal.dot(middle) < 0) normal = -normal;
    double least = 0;
    for (int row = 0; row < kRaysPerAxis; ++row) {
      for (int column = 0; column < kRaysPerAxis; ++column)
        least = std::min(least, normal.dot(grid_ray(camera, column, row)));
    }
    sides_[i] = {normal.cast<float>(), static_cast<float>(least) - kSideMargin};
  }
}

bool Frustum::may_hold(const Eigen::Vector3f& center, float radius) const {
  const float reach = center.norm() + radius;
  return std::all_of(sides_.begin(), sides_.end(),
                     [&](const Side& side) { return side.normal.dot(center) + radius >= side.sine * reach; });
}

namespace {

CAIRN_INLINE BlockView view(const PointBlock& block, const Frustum& frustum, const SE3& camera_from_map,
                            float focal_length) {
  const Eigen::Matrix3f rotation = camera_from_map.rotation_matrix().cast<float>();
  const Eigen::Vector3f eye = camera_from_map.center().cast<float>();
  std::array<Eigen::Vector3f, 4> normal;  // map frame
  std::array<float, 4> limit{};
  for (size_t i = 0; i < normal.size(); ++i) {
    normal[i] = rotation.transpose() * frustum.sides()[i].normal;
    limit[i] = signed_square(frustum.sides()[i].sine);
  }
  const Eigen::Vector3f axis = rotation.row(2).transpose();
  const float area_scale = std::pow(focal_length, 4.0F) / (kCoarseArea * kCoarseArea);
  alignas(32) Lanes passed;
  alignas(32) Lanes coarse;
  for (size_t s = 0; s < kBlockSlots; ++s) {
    const float x = block.x[s] - eye.x();
    const float y = block.y[s] - eye.y();
    const float z = block.z[s] - eye.z();
    const float squared = x * x + y * y + z * z;
    const float depth = axis.x() * x + axis.y() * y + axis.z() * z;
    const auto inside = [&](size_t i) {
      const float height = normal[i].x() * x + normal[i].y() * y + normal[i].z() * z;
      return static_cast<int32_t>(signed_square(height) >= limit[i] * squared);
    };
    // cos(angle + extra); beyond 180 degrees all sides will do.
    const float cosine = block.view_cosine[s];
    const float least = cosine * kExtraAngleCosine - block.view_sine[s] * kExtraAngleSine;
    const float towards = -(block.view_x[s] * x + block.view_y[s] * y + block.view_z[s] * z);
    const float nearest = kNearer * block.nearest[s];
    const float farthest = kFarther * block.farthest[s];
    passed[s] = static_cast<int32_t>(depth >= kNearest) & inside(0) & inside(1) & inside(2) & inside(3) &
                (static_cast<int32_t>(cosine <= -kExtraAngleCosine) |
                 static_cast<int32_t>(signed_square(towards) >= signed_square(least) * squared)) &
                static_cast<int32_t>(squared >= nearest * nearest) &
                static_cast<int32_t>(squared <= farthest * farthest);
    const float facing = block.span_x[s] * x + block.span_y[s] * y + block.span_z[s] * z;
    const float bounded = std::max(depth * depth, kMinDepthShare * kMinDepthShare * squared);
    coarse[s] = static_cast<int32_t>(area_scale * facing * facing > bounded * bounded * bounded);
  }
  return {bits_of(passed) & block.live, bits_of(coarse)};
}

CAIRN_WIDE BlockView view_wide(const PointBlock& block, const Frustum& frustum, const SE3& camera_from_map,
                               float focal_length) {
  return view(block, frustum, camera_from_map, focal_length);
}

BlockView view_narrow(const PointBlock& block, const Frustum& frustum, const SE3& camera_from_map,
                      float focal_length) {
  return view(block, frustum, camera_from_map, focal_length);
}

}  // namespace

BlockView kernels::view_block(const PointBlock& block, const Frustum& frustum, const SE3& camera_from_map,
                              float focal_length, Simd simd) {
  return simd == Simd::kWide ? view_wide(block, frustum, camera_from_map, focal_length)
                             : view_narrow(block, frustum, camera_from_map, focal_length);
}

BlockView view_block(const PointBlock& block, const Frustum& frustum, const SE3& camera_from_map,
                     float focal_length) {
  return kernels::view_block(block, frustum, camera_from_map, focal_length, best_simd());
}

}  // namespace cairn
