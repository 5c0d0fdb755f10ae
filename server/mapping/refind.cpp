// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/refind.h"

#include "server/mapping/patch_view.h"

namespace cairn {
bool should_see(const MapState& map, const MapPoint& point, const Eigen::Vector3d& camera_center,
                double visible_cosine) {
  const Eigen::Vector3d source_center = map.keyframe(point.source->keyframe).camera_from_map.center();
  const Eigen::Vector3d to_source = source_center - point.position;
  const Eigen::Vector3d to_camera = camera_center - point.position;
  return to_source.dot(to_camera) > visible_cosine * to_source.norm() * to_camera.norm();
}

bool refind(MapState* map, KeyframeId keyframe_id, PointId point_id, const RefindOptions& options) {
  const MapPoint& point = map->point(point_id);
  const MapKeyframe& keyframe = map->keyframe(keyframe_id);
  if (!point.live || !keyframe.live) return false;
  const auto pixel = keyframe.camera->project(keyframe.camera_from_map * point.position);
  if (!pixel || !keyframe.camera->in_image(*pixel, options.image_border)) return false;
  if (map->find_measurement(keyframe_id, point_id) || map->has_given_up(keyframe_id, point_id)) return false;
  if (!should_see(*map, point, keyframe.camera_from_map.center(), options.visible_cosine)) return false;
  const auto view = view_point(*map, point, keyframe);
  if (!view || !keyframe.camera->in_image(view->pixel, options.image_border * (1 << view->level)))
    return false;
  const auto found = find_near_corner(*point.source, *view, *keyframe.images, options.radius);
  MapPoint& counted = map->point(point_id);
  if (!found) {
    if (!keyframe.adds_only) ++counted.attempts;
    map->give_up(keyframe_id, point_id);
    return true;
  }
  ++counted.attempts;
  ++counted.found;
  map->add_measurement(keyframe_id, {point_id, found->level, found->pixel});
  return true;
}

int refind_all(MapState* map, KeyframeId keyframe_id, const RefindOptions& options) {
  const size_t before = map->keyframe(keyframe_id).measurements.size();
  for (const PointId point : map->live_point_ids()) refind(map, keyframe_id, point, options);
  return static_cast<int>(map->keyframe(keyframe_id).measurements.size() - before);
}

}  // namespace cairn
