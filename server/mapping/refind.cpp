// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/refind.h"

#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

constexpr float kRefindRadius = 4.0F;  ///< [search-level px] PTAM r114
constexpr double kVisibleCosine =
    0.7;  ///< 45 degrees off the source's direction: beyond, the patch is another one
constexpr double kImageBorder = 6;  ///< [search-level px] of the projection from the image's edge

}  // namespace

bool should_see(const MapState& map, const MapPoint& point, const Eigen::Vector3d& camera_center) {
  const Eigen::Vector3d source_center = map.keyframe(point.source->keyframe).camera_from_map.center();
  const Eigen::Vector3d to_source = source_center - point.position;
  const Eigen::Vector3d to_camera = camera_center - point.position;
  return to_source.dot(to_camera) > kVisibleCosine * to_source.norm() * to_camera.norm();
}

bool refind(MapState* map, KeyframeId keyframe_id, PointId point_id) {
  const MapPoint& point = map->point(point_id);
  const MapKeyframe& keyframe = map->keyframe(keyframe_id);
  if (!point.live || !keyframe.live) return false;
  const auto pixel = keyframe.camera->project(keyframe.camera_from_map * point.position);
  if (!pixel || !keyframe.camera->in_image(*pixel, kImageBorder)) return false;
  if (map->find_measurement(keyframe_id, point_id) || map->has_given_up(keyframe_id, point_id)) return false;
  if (!should_see(*map, point, keyframe.camera_from_map.center())) return false;
  const auto view = view_point(*map, point, keyframe);
  if (!view || !keyframe.camera->in_image(view->pixel, kImageBorder * (1 << view->level))) return false;
  const auto found = find_near_corner(*point.source, *view, *keyframe.images, kRefindRadius);
  MapPoint& counted = map->point(point_id);
  ++counted.attempts;
  if (!found) {
    map->give_up(keyframe_id, point_id);
    return true;
  }
  ++counted.found;
  map->add_measurement(keyframe_id, {point_id, found->level, found->pixel});
  return true;
}

int refind_all(MapState* map, KeyframeId keyframe_id) {
  const size_t before = map->keyframe(keyframe_id).measurements.size();
  for (const PointId point : map->live_point_ids()) refind(map, keyframe_id, point);
  return static_cast<int>(map->keyframe(keyframe_id).measurements.size() - before);
}

}  // namespace cairn
