// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/patch_view.h"

#include <cmath>

namespace cairn {
namespace {

constexpr double kMinPlaneCosine = 0.05;  ///< a ray flatter on the patch's plane gives no warp

Eigen::Vector3f ray_through(const Camera& camera, int level, float x, float y) {
  return camera.unproject({from_level(x, level), from_level(y, level)}).cast<float>();
}

Eigen::Vector2f level_position(const Eigen::Vector2f& pixel, int level) {
  return {to_level(pixel.x(), level), to_level(pixel.y(), level)};
}

PatchFound found_at(const Eigen::Vector2f& at_level, int level) {
  return {{from_level(at_level.x(), level), from_level(at_level.y(), level)}, static_cast<uint8_t>(level)};
}

}  // namespace

std::optional<PointSource> make_source(const MapKeyframe& keyframe, int level, Corner corner) {
  PointSource source;
  if (!cut_source_patch(keyframe.images->level(level), corner, &source.pixels)) return std::nullopt;
  source.keyframe = keyframe.id;
  source.level = static_cast<uint8_t>(level);
  source.corner = corner;
  aim_source(*keyframe.camera, &source);
  return source;
}

void aim_source(const Camera& camera, PointSource* source) {
  const auto x = static_cast<float>(source->corner.x);
  const auto y = static_cast<float>(source->corner.y);
  source->ray_center = ray_through(camera, source->level, x, y);
  source->ray_right = ray_through(camera, source->level, x + 1, y);
  source->ray_down = ray_through(camera, source->level, x, y + 1);
  source->normal = -source->ray_center;
}

std::optional<PatchView> view_patch(const PointSource& source, const Eigen::Vector3d& point,
                                    const SE3& target_from_source, const Camera& target) {
  const Eigen::Vector3d normal = source.normal.cast<double>();
  const Eigen::Vector3d rays[3] = {source.ray_center.cast<double>(), source.ray_right.cast<double>(),
                                   source.ray_down.cast<double>()};
  const double offset = normal.dot(point);
  Eigen::Vector3d on_plane[3];
  for (int i = 0; i < 3; ++i) {
    const double cosine = normal.dot(rays[i]);
    if (std::abs(cosine) < kMinPlaneCosine) return std::nullopt;
    on_plane[i] = rays[i] * (offset / cosine);
  }
  const Eigen::Matrix3d R = target_from_source.rotation_matrix();
  Matrix23d d_pixel;
  const auto pixel = target.project(R * point + target_from_source.translation(), &d_pixel);
  if (!pixel || !target.in_image(*pixel)) return std::nullopt;
  PatchView view;
  view.pixel = *pixel;
  const Matrix23d d_pixel_d_source = d_pixel * R;
  view.warp.col(0) = (d_pixel_d_source * (on_plane[1] - on_plane[0])).cast<float>();
  view.warp.col(1) = (d_pixel_d_source * (on_plane[2] - on_plane[0])).cast<float>();
  const auto level = warp_level(view.warp);
  if (!level) return std::nullopt;
  view.level = *level;
  return view;
}

std::optional<PatchFound> find_near_corner(const PointSource& source, const PatchView& view,
                                           const KeyframeImages& images, float radius) {
  PatchTemplate patch;
  if (!make_template(source.pixels, view.warp, view.level, &patch)) return std::nullopt;
  const GrayView image = images.level(view.level);
  const auto match = find_patch(patch, image, images.corners[static_cast<size_t>(view.level)],
                                level_position(view.pixel.cast<float>(), view.level), radius, kSearchZmssd);
  if (!match) return std::nullopt;
  const auto refined = refine_patch(patch, image, {match->corner.x, match->corner.y});
  if (!refined) return std::nullopt;
  return found_at(*refined, view.level);
}

std::optional<PatchFound> refine_from(const PointSource& source, const PatchView& view,
                                      const KeyframeImages& images, const Eigen::Vector2f& start,
                                      float max_shift) {
  PatchTemplate patch;
  if (!make_template(source.pixels, view.warp, view.level, &patch)) return std::nullopt;
  const auto refined =
      refine_patch(patch, images.level(view.level), level_position(start, view.level), 10, max_shift);
  if (!refined) return std::nullopt;
  return found_at(*refined, view.level);
}

std::optional<PatchView> view_point(const MapState& map, const MapPoint& point, const MapKeyframe& keyframe) {
  const SE3& source_from_map = map.keyframe(point.source->keyframe).camera_from_map;
  return view_patch(*point.source, source_from_map * point.position,
                    keyframe.camera_from_map * source_from_map.inverse(), *keyframe.camera);
}

}  // namespace cairn
