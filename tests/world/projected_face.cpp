// SPDX-License-Identifier: Apache-2.0
#include "tests/world/projected_face.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr double kNearDepth = 0.01;  // m; a face with a corner nearer than this is taken to span the view

LinearFunction linear(const Eigen::Vector3d& coefficients) {
  const Eigen::Vector3f f = coefficients.cast<float>();
  return {f.x(), f.y(), f.z()};
}

IdealBox bounds_of(const std::array<Eigen::Vector3d, kMaxFaceCorners>& corners, int count,
                   const IdealBox& view) {
  Eigen::Array2d low = Eigen::Array2d::Constant(1e9);
  Eigen::Array2d high = -low;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d& corner = corners[static_cast<size_t>(i)];
    if (corner.z() < kNearDepth) return view;
    const Eigen::Array2d ideal = corner.head<2>().array() / corner.z();
    low = low.min(ideal);
    high = high.max(ideal);
  }
  return {static_cast<float>(low.x()), static_cast<float>(low.y()), static_cast<float>(high.x()),
          static_cast<float>(high.y())};
}

}  // namespace

std::optional<ProjectedFace> project_face(const Face& face, const Texture& texture,
                                          const SE3& camera_from_map, const IdealBox& view) {
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  const Eigen::Vector3d normal = rotation * face.normal;
  const double plane =
      normal.dot(camera_from_map * face.corners.front());  // normal.dot(p) == plane on the face
  if (plane >= -1e-9) return std::nullopt;

  std::array<Eigen::Vector3d, kMaxFaceCorners> corners;
  ProjectedFace result;
  result.edge_count = static_cast<int>(face.corners.size());
  double nearest_depth = 1e9;
  double farthest_depth = -1e9;
  for (size_t i = 0; i < face.corners.size(); ++i) {
    corners[i] = rotation * face.corners[i] + camera_from_map.translation();
    nearest_depth = std::min(nearest_depth, corners[i].z());
    farthest_depth = std::max(farthest_depth, corners[i].z());
  }
  if (farthest_depth < kNearDepth) return std::nullopt;
  result.bounds = bounds_of(corners, result.edge_count, view);
  if (!result.bounds.overlaps(view)) return std::nullopt;

  for (size_t i = 0; i < face.corners.size(); ++i) {
    // Corners run counter-clockwise seen from the front with y up, hence clockwise in an image with y down.
    const Eigen::Vector3d& next = corners[(i + 1) % face.corners.size()];
    result.edges[i] = linear(next.cross(corners[i]).normalized());
  }
  const Eigen::Vector3d inverse_depth = normal / plane;
  const auto over_depth = [&](const Eigen::Vector3d& axis, double offset) {
    const Eigen::Vector3d camera_axis = rotation * axis;
    return linear(camera_axis + (offset - camera_axis.dot(camera_from_map.translation())) * inverse_depth);
  };
  result.inverse_depth = linear(inverse_depth);
  result.u_over_depth = over_depth(face.u_axis, face.u_offset);
  result.v_over_depth = over_depth(face.v_axis, face.v_offset);
  result.brightness = face.brightness;
  result.texture = &texture;
  result.nearest = static_cast<float>(1.0 / std::max(nearest_depth, kNearDepth));
  return result;
}

}  // namespace cairn
