// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include "common/geometry/se3.h"
#include "tests/world/scenario.h"

namespace cairn {

/// A linear function of an ideal image point (x, y) in the plane z = 1: x * dx + y * dy + constant.
struct LinearFunction {
  float dx = 0;
  float dy = 0;
  float constant = 0;

  [[nodiscard]] float operator()(float x, float y) const { return x * dx + y * dy + constant; }
  [[nodiscard]] LinearFunction operator-(const LinearFunction& other) const {
    return {dx - other.dx, dy - other.dy, constant - other.constant};
  }
};

/// Axis-aligned box in the ideal image plane z = 1.
struct IdealBox {
  float x0 = 0;
  float y0 = 0;
  float x1 = 0;
  float y1 = 0;

  [[nodiscard]] bool overlaps(const IdealBox& other) const {
    return x0 <= other.x1 && other.x0 <= x1 && y0 <= other.y1 && other.y0 <= y1;
  }
  /// The smallest box about both.
  [[nodiscard]] IdealBox united(const IdealBox& other) const {
    return {std::min(x0, other.x0), std::min(y0, other.y0), std::max(x1, other.x1), std::max(y1, other.y1)};
  }
  [[nodiscard]] float minimum(const LinearFunction& f) const {
    return f(f.dx > 0 ? x0 : x1, f.dy > 0 ? y0 : y1);
  }
  [[nodiscard]] float maximum(const LinearFunction& f) const {
    return f(f.dx > 0 ? x1 : x0, f.dy > 0 ? y1 : y0);
  }
};

/// A face as one camera position sees it. Over the ideal image plane the inverse depth and the texture
/// coordinates divided by depth are linear, and a point is inside the face exactly where every edge function
/// is >= 0: no clipping is needed, also with corners behind the camera (2-D homogeneous rasterization, Olano
/// and Greer, 1997).
struct ProjectedFace {
  LinearFunction inverse_depth;  ///< [1/m], > 0 inside the face
  LinearFunction u_over_depth;   ///< [texel/m]
  LinearFunction v_over_depth;
  std::array<LinearFunction, kMaxFaceCorners> edges;
  int edge_count = 0;
  float brightness = 1;
  const Texture* texture = nullptr;
  IdealBox bounds;
  float nearest = 0;  ///< largest inverse depth of a corner in front of the camera
};

/// Whether `front` is nearer than `back` all over the box (as far as their planes go).
[[nodiscard]] inline bool hides(const IdealBox& box, const ProjectedFace& front, const ProjectedFace& back) {
  return box.maximum(back.inverse_depth - front.inverse_depth) < 0;
}

/// A rigid motion ready for many points.
struct ViewMatrix {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;

  explicit ViewMatrix(const SE3& pose) : rotation(pose.rotation_matrix()), translation(pose.translation()) {}
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
};

/// Nothing if the face shows its back, lies behind the camera or outside `view`.
[[nodiscard]] std::optional<ProjectedFace> project_face(const Face& face, const Texture& texture,
                                                        const ViewMatrix& camera_from_body,
                                                        const IdealBox& view);

/// Neighbouring faces of one body, in a ball.
struct FaceCluster {
  size_t first = 0;  ///< into Scenario::faces
  size_t count = 0;
  int body = 0;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< of the ball, in the body's coordinates
  double radius = 0;

  /// Whether any of it may show in `view`.
  [[nodiscard]] bool may_show(const ViewMatrix& camera_from_body, const IdealBox& view) const;
};

/// Runs of faces of the same body and place.
[[nodiscard]] std::vector<FaceCluster> cluster_faces(const std::vector<Face>& faces);

}  // namespace cairn
