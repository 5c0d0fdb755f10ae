// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/frustum.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

Eigen::Vector3d grid_ray(const Camera& camera, int rays_per_axis, int column, int row) {
  const double step = 1.0 / (rays_per_axis - 1);
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

Frustum::Frustum(const Camera& camera, const FrustumOptions& options)
    : options_(options),
      extra_cosine_(static_cast<float>(std::cos(options.extra_angle))),
      extra_sine_(static_cast<float>(std::sin(options.extra_angle))) {
  const int last = options.rays_per_axis - 1;
  const std::array<std::array<int, 2>, 4> corners = {{{0, 0}, {last, 0}, {last, last}, {0, last}}};
  const auto ray = [&](int column, int row) { return grid_ray(camera, options.rays_per_axis, column, row); };
  const Eigen::Vector3d middle = ray(last / 2, last / 2);
  for (size_t i = 0; i < sides_.size(); ++i) {
    const auto& from = corners[i];
    const auto& to = corners[(i + 1) % corners.size()];
    Eigen::Vector3d normal = ray(from[0], from[1]).cross(ray(to[0], to[1])).normalized();
    if (normal.dot(middle) < 0) normal = -normal;
    double least = 0;
    for (int row = 0; row <= last; ++row) {
      for (int column = 0; column <= last; ++column) least = std::min(least, normal.dot(ray(column, row)));
    }
    sides_[i] = {normal.cast<float>(), static_cast<float>(least) - options.side_margin};
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
  const FrustumOptions options = frustum.options();
  const float extra_cosine = frustum.extra_cosine();
  const float extra_sine = frustum.extra_sine();
  const Eigen::Matrix3f rotation = camera_from_map.rotation_matrix().cast<float>();
  const Eigen::Vector3f eye = camera_from_map.center().cast<float>();
  std::array<Eigen::Vector3f, 4> normal;  // map frame
  std::array<float, 4> limit{};
  for (size_t i = 0; i < normal.size(); ++i) {
    normal[i] = rotation.transpose() * frustum.sides()[i].normal;
    limit[i] = signed_square(frustum.sides()[i].sine);
  }
  const Eigen::Vector3f axis = rotation.row(2).transpose();
  const float area_scale = std::pow(focal_length, 4.0F) / (options.coarse_area * options.coarse_area);
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
    const float least = cosine * extra_cosine - block.view_sine[s] * extra_sine;
    const float towards = -(block.view_x[s] * x + block.view_y[s] * y + block.view_z[s] * z);
    const float nearest = options.nearer * block.nearest[s];
    const float farthest = options.farther * block.farthest[s];
    passed[s] = static_cast<int32_t>(depth >= options.nearest) & inside(0) & inside(1) & inside(2) &
                inside(3) &
                (static_cast<int32_t>(cosine <= -extra_cosine) |
                 static_cast<int32_t>(signed_square(towards) >= signed_square(least) * squared)) &
                static_cast<int32_t>(squared >= nearest * nearest) &
                static_cast<int32_t>(squared <= farthest * farthest);
    const float facing = block.span_x[s] * x + block.span_y[s] * y + block.span_z[s] * z;
    const float bounded =
        std::max(depth * depth, options.min_depth_share * options.min_depth_share * squared);
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
