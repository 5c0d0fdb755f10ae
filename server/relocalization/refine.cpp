// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/refine.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace cairn {
namespace {

/// The keyframe that a pose comes from, and those of the others that see about what the pose sees.
std::vector<size_t> keyframes_around(const IndexedMap& map, const SE3& camera_from_map, size_t keyframe,
                                     const RefineOptions& options) {
  std::vector<std::pair<double, size_t>> ranked;
  const Eigen::Vector3d axis = camera_from_map.rotation_matrix().row(2);
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    const KeyframePose* pose = map.snapshot->find(map.keyframes[i]->id);
    if (pose == nullptr || i == keyframe) continue;
    const double depth = std::max(1e-6, static_cast<double>(pose->mean_depth));
    const double distance = (pose->camera_from_map.center() - camera_from_map.center()).norm() / depth;
    const Eigen::Vector3d its_axis = pose->camera_from_map.rotation_matrix().row(2);
    ranked.emplace_back(distance + options.angle_weight * (its_axis - axis).norm(), i);
  }
  const size_t others = std::min<size_t>(ranked.size(), options.neighbourhood - 1);
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<ptrdiff_t>(others), ranked.end());
  ranked.resize(others);
  std::vector<size_t> around = {keyframe};
  for (const auto& [_, i] : ranked) around.push_back(i);
  return around;
}

/// Keeps `count` of the points, evenly spread over their order.
void keep_some(size_t count, std::vector<ProjectedPoint>* points) {
  if (points->size() <= count) return;
  const size_t all = points->size();
  for (size_t i = 0; i < count; ++i) (*points)[i] = (*points)[i * all / count];
  points->resize(count);
}

}  // namespace

std::optional<Eigen::Matrix<double, 2, 6>> pixel_by_pose(const Camera& camera, const Eigen::Vector3d& seen) {
  Matrix23d d_pixel_d_point;
  if (!camera.project(seen, &d_pixel_d_point)) return std::nullopt;
  Eigen::Matrix<double, 2, 6> d_pixel_d_pose;
  d_pixel_d_pose.leftCols<3>() = d_pixel_d_point;
  for (int i = 0; i < 2; ++i)
    d_pixel_d_pose.block<1, 3>(i, 3) = seen.cross(d_pixel_d_point.row(i).transpose()).transpose();
  return d_pixel_d_pose;
}

double variance_of_pixel(const Camera& camera, const PoseEstimate& pose, const Eigen::Vector3d& point) {
  const auto d_pixel_d_pose = pixel_by_pose(camera, pose.camera_from_map * point);
  if (!d_pixel_d_pose) return std::numeric_limits<double>::infinity();
  return (*d_pixel_d_pose * pose.covariance * d_pixel_d_pose->transpose()).trace();
}

void keep_certain(const Camera& camera, const PoseEstimate& pose, double radius, ProjectedPoints* points,
                  const RefineOptions& options) {
  std::erase_if(points->points, [&](const ProjectedPoint& point) {
    int finest = kPyramidLevels;
    for (const KeyframeSighting& s : points->sightings_of(point))
      finest = std::min<int>(finest, s.sighting->level);
    const double reach = radius * (1 << finest) / options.certainty;
    return variance_of_pixel(camera, pose, point.position) > reach * reach;
  });
}

Result<Refined> refine(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                       const IndexedMap& map, size_t keyframe, PoseEstimate pose,
                       const RefineOptions& options, const MatchOptions& matching) {
  Refined refined{std::move(pose), {}, {}};
  const float white = white_share(view.small);
  for (size_t step = 0; step < options.radii.size(); ++step) {
    const double radius = options.radii[step];
    const SE3 camera_from_map = refined.pose.camera_from_map;
    project_points(camera, camera_from_map, map, keyframes_around(map, camera_from_map, keyframe, options),
                   white, &refined.points);
    if (step + 1 < options.radii.size()) {
      keep_certain(camera, refined.pose, radius, &refined.points, options);
      keep_some(options.enough_for_pose, &refined.points.points);
    }
    refined.guided = match_near(view, grid, refined.points, radius, matching);
    PoseOptions fit;
    fit.fixed_cutoff_after = 0;
    fit.late_squared_cutoff = radius * radius;
    auto next = optimize_pose(camera, camera_from_map, to_observations(view, refined.guided.matches), fit);
    if (!next) return tl::unexpected(next.error());
    refined.pose = std::move(*next);
  }
  return refined;
}

}  // namespace cairn
