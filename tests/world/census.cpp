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

std::vector<Census::Hit> Census::cast(std::span<const ViewMatrix> camera_from_body,
                                      std::span<const Eigen::Vector2f> rays, const IdealBox& view) const {
  std::vector<Hit> hits(rays.size());
  for (const FaceCluster& cluster : clusters_) {
    const ViewMatrix& pose = camera_from_body[static_cast<size_t>(cluster.body)];
    if (!cluster.may_show(pose, view)) continue;
    for (const Face& face : std::span(scenario_.faces).subspan(cluster.first, cluster.count)) {
      const auto projected =
          project_face(face, scenario_.textures[static_cast<size_t>(face.texture)], pose, view);
      if (!projected) continue;
      for (size_t i = 0; i < rays.size(); ++i) {
        const float inverse_depth = projected->inverse_depth(rays[i].x(), rays[i].y());
        if (inverse_depth <= hits[i].inverse_depth || !covers(*projected, rays[i])) continue;
        hits[i] = {inverse_depth, face.place};
      }
    }
  }
  return hits;
}

Census::Survey Census::survey(std::span<const ViewMatrix> camera_from_body) const {
  Survey survey{std::vector<double>(scenario_.places.size(), 0.0)};
  std::vector<float> inverse_depths;
  for (const Hit& hit : cast(camera_from_body, rays_, view_)) {
    if (hit.place >= 0) {
      survey.shares[static_cast<size_t>(hit.place)] += 1.0 / static_cast<double>(rays_.size());
    }
    if (hit.inverse_depth > 0) inverse_depths.push_back(hit.inverse_depth);
  }
  if (inverse_depths.empty()) return survey;
  const auto middle = inverse_depths.begin() + static_cast<std::ptrdiff_t>(inverse_depths.size() / 2);
  std::ranges::nth_element(inverse_depths, middle);
  survey.depth = 1 / static_cast<double>(*middle);
  return survey;
}

std::optional<Sight> Census::look(std::span<const ViewMatrix> camera_from_body,
                                  const Eigen::Vector2d& ray) const {
  const Eigen::Vector2f point = ray.cast<float>();
  const Hit hit = cast(camera_from_body, {&point, 1}, {point.x(), point.y(), point.x(), point.y()}).front();
  if (hit.inverse_depth <= 0) return std::nullopt;
  return Sight{hit.place, 1.0 / static_cast<double>(hit.inverse_depth)};
}

}  // namespace cairn
