// SPDX-License-Identifier: Apache-2.0
#include "tests/world/census.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr int kColumns = 32;
constexpr int kRows = 24;

bool covers(const ProjectedFace& face, const Eigen::Vector2f& ray) {
  return std::all_of(face.edges.begin(), face.edges.begin() + face.edge_count,
                     [&](const LinearFunction& edge) { return edge(ray.x(), ray.y()) >= 0; });
}

}  // namespace

Census::Census(const Scenario& scenario) : scenario_(scenario), clusters_(cluster_faces(scenario.faces)) {
  const Camera& camera = *scenario.camera;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Eigen::Vector3d ray = camera.unproject(
          {(column + 0.5) * camera.width() / kColumns - 0.5, (row + 0.5) * camera.height() / kRows - 0.5});
      rays_.emplace_back((ray.head<2>() / ray.z()).cast<float>());
      const IdealBox point{rays_.back().x(), rays_.back().y(), rays_.back().x(), rays_.back().y()};
      view_ = rays_.size() == 1 ? point : view_.united(point);
    }
  }
}

std::vector<double> Census::shares(std::span<const ViewMatrix> camera_from_body) const {
  std::vector<float> nearest(rays_.size(), 0);
  std::vector<int> place(rays_.size(), -1);
  for (const FaceCluster& cluster : clusters_) {
    const ViewMatrix& pose = camera_from_body[static_cast<size_t>(cluster.body)];
    if (!cluster.may_show(pose, view_)) continue;
    for (const Face& face : std::span(scenario_.faces).subspan(cluster.first, cluster.count)) {
      const auto projected =
          project_face(face, scenario_.textures[static_cast<size_t>(face.texture)], pose, view_);
      if (!projected) continue;
      for (size_t i = 0; i < rays_.size(); ++i) {
        const float inverse_depth = projected->inverse_depth(rays_[i].x(), rays_[i].y());
        if (inverse_depth <= nearest[i] || !covers(*projected, rays_[i])) continue;
        nearest[i] = inverse_depth;
        place[i] = face.place;
      }
    }
  }
  std::vector<double> shares(scenario_.places.size(), 0.0);
  for (const int seen : place) {
    if (seen >= 0) shares[static_cast<size_t>(seen)] += 1.0 / static_cast<double>(rays_.size());
  }
  return shares;
}

}  // namespace cairn
