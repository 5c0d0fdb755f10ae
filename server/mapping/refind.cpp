// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/refind.h"

#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

constexpr float kRefindRadius = 4.0F;  ///< [search-level px] PTAM r114
constexpr double kVisibleCosine =
    0.7;  ///< 45 degrees off the source's direction: beyond, the patch is another one
constexpr double kImageBorder = 6;  ///< [search-level px] of the projection from the image's edge

/// Whether a point shows a camera about the side that its source keyframe saw.
bool shows_its_side(const MapState& map, const MapPoint& point, const Eigen::Vector3d& camera_center) {
  const Eigen::Vector3d source_center = map.keyframe(point.source.keyframe).camera_from_map.center();
  const Eigen::Vector3d to_source = source_center - point.position;
  const Eigen::Vector3d to_camera = camera_center - point.position;
  return to_source.dot(to_camera) > kVisibleCosine * to_source.norm() * to_camera.norm();
}

/// What is nearer along a ray hides what is farther, under any lens.
float range_of(const MapKeyframe& keyframe, const MapPoint& point) {
  return static_cast<float>((keyframe.camera_from_map * point.position).norm());
}

DepthOrder order_of_measured(const MapState& map, const MapKeyframe& keyframe) {
  DepthOrder order(keyframe.camera->width(), keyframe.camera->height());
  for (const Measurement& m : keyframe.measurements)
    order.add(m.pixel, range_of(keyframe, map.point(m.point)));
  return order;
}

}  // namespace

Refinder::Sight Refinder::search(const MapKeyframe& keyframe, PointId id) {
  MapPoint& point = map_.point(id);
  if (!point.live || !keyframe.live) return Sight::kNotExpected;
  const auto pixel = keyframe.camera->project(keyframe.camera_from_map * point.position);
  if (!pixel || !keyframe.camera->in_image(*pixel, kImageBorder)) return Sight::kNotExpected;
  if (map_.find_measurement(keyframe.id, id) || map_.has_given_up(keyframe.id, id))
    return Sight::kNotExpected;
  if (!shows_its_side(map_, point, keyframe.camera_from_map.center())) return Sight::kNotExpected;
  const auto view = view_point(map_, point, keyframe);
  if (!view || !keyframe.camera->in_image(view->pixel, kImageBorder * (1 << view->level)))
    return Sight::kNotExpected;
  const auto found = find_near_corner(point.source, *view, *keyframe.images, kRefindRadius);
  if (!found) return Sight::kMissed;
  ++point.attempts;
  ++point.found;
  map_.add_measurement(keyframe.id, {id, found->level, found->pixel});
  return Sight::kFound;
}

bool Refinder::is_hidden(const MapKeyframe& keyframe, const MapPoint& point) {
  const auto pixel = keyframe.camera->project(keyframe.camera_from_map * point.position);
  if (!pixel) return false;
  if (orders_.size() < map_.keyframes().size()) orders_.resize(map_.keyframes().size());
  std::optional<DepthOrder>& order = orders_[keyframe.id.value - 1];
  if (!order) order = order_of_measured(map_, keyframe);
  return order->is_hidden(pixel->cast<float>(), range_of(keyframe, point), kClearlyBehind);
}

bool Refinder::give_up_unless_hidden(const MapKeyframe& keyframe, PointId id) {
  MapPoint& point = map_.point(id);
  if (is_hidden(keyframe, point)) return false;
  ++point.attempts;
  map_.give_up(keyframe.id, id);
  return true;
}

bool Refinder::refind(KeyframeId keyframe_id, PointId point) {
  const MapKeyframe& keyframe = map_.keyframe(keyframe_id);
  const Sight sight = search(keyframe, point);
  return sight == Sight::kFound || (sight == Sight::kMissed && give_up_unless_hidden(keyframe, point));
}

int Refinder::refind_all(KeyframeId keyframe_id) {
  const MapKeyframe& keyframe = map_.keyframe(keyframe_id);
  const size_t before = keyframe.measurements.size();
  std::vector<PointId> missed;
  for (const PointId point : map_.live_point_ids()) {
    if (search(keyframe, point) == Sight::kMissed) missed.push_back(point);
  }
  for (const PointId point : missed) give_up_unless_hidden(keyframe, point);
  return static_cast<int>(keyframe.measurements.size() - before);
}

}  // namespace cairn
