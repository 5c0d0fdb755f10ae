// SPDX-License-Identifier: Apache-2.0
#include "tests/world/projected_face.h"

#include <Eigen/Geometry>
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
                                          const ViewMatrix& camera_from_body, const IdealBox& view) {
  const Eigen::Matrix3d& rotation = camera_from_body.rotation;
  const Eigen::Vector3d normal = rotation * face.normal;
  const double plane =
      normal.dot(camera_from_body * face.corners.front());  // normal.dot(p) == plane on the face
  if (plane >= -1e-9) return std::nullopt;

  std::array<Eigen::Vector3d, kMaxFaceCorners> corners;
  ProjectedFace result;
  result.edge_count = static_cast<int>(face.corners.size());
  double nearest_depth = 1e9;
  double farthest_depth = -1e9;
  for (size_t i = 0; i < face.corners.size(); ++i) {
    corners[i] = camera_from_body * face.corners[i];
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
    return linear(camera_axis + (offset - camera_axis.dot(camera_from_body.translation)) * inverse_depth);
  };
  result.inverse_depth = linear(inverse_depth);
  result.u_over_depth = over_depth(face.u_axis, face.u_offset);
  result.v_over_depth = over_depth(face.v_axis, face.v_offset);
  result.brightness = face.brightness;
  result.texture = &texture;
  result.nearest = static_cast<float>(1.0 / std::max(nearest_depth, kNearDepth));
  return result;
}

bool FaceCluster::may_show(const ViewMatrix& camera_from_body, const IdealBox& view) const {
  const Eigen::Vector3d ball = camera_from_body * centre;
  // Planes through the eye and the sides of the view, normals inwards.
  const std::array<Eigen::Vector3d, 4> sides = {
      Eigen::Vector3d(1, 0, -view.x0), {-1, 0, view.x1}, {0, 1, -view.y0}, {0, -1, view.y1}};
  return std::ranges::all_of(
             sides, [&](const Eigen::Vector3d& side) { return side.dot(ball) >= -radius * side.norm(); }) &&
         ball.z() > -radius;
}

std::vector<FaceCluster> cluster_faces(const std::vector<Face>& faces) {
  std::vector<FaceCluster> clusters;
  for (size_t first = 0; first < faces.size();) {
    FaceCluster cluster;
    cluster.first = first;
    cluster.body = faces[first].body;
    Eigen::AlignedBox3d box;
    for (; first < faces.size() && faces[first].body == cluster.body &&
           faces[first].place == faces[cluster.first].place;
         ++first) {
      for (const Eigen::Vector3d& corner : faces[first].corners) box.extend(corner);
    }
    cluster.count = first - cluster.first;
    cluster.centre = box.center();
    cluster.radius = 0.5 * box.diagonal().norm();
    clusters.push_back(cluster);
  }
  return clusters;
}

}  // namespace cairn
