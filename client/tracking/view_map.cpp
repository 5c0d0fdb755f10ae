// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/view_map.h"

#include "common/image/frame_images.h"

namespace cairn::test {
namespace {

PointSource make_source(const Camera& camera, const View& view, int level, Corner corner, uint64_t id) {
  PointSource source;
  source.id = PointId{id};
  source.keyframe = KeyframeId{1};
  source.level = static_cast<uint8_t>(level);
  source.corner = corner;
  const auto ray = [&](int dx, int dy) -> Eigen::Vector3f {
    return camera
        .unproject({from_level(static_cast<float>(corner.x + dx), level),
                    from_level(static_cast<float>(corner.y + dy), level)})
        .cast<float>();
  };
  source.ray_center = ray(0, 0);
  source.ray_right = ray(1, 0);
  source.ray_down = ray(0, 1);
  source.normal = view.normal
                      ? Eigen::Vector3f((view.camera_from_map.rotation() * *view.normal).cast<float>())
                      : Eigen::Vector3f(-source.ray_center);
  return source;
}

}  // namespace

MapSnapshotPtr map_of_view(const Camera& camera, const GrayView& image, const View& view,
                           const std::function<Eigen::Vector3d(const Eigen::Vector3d& ray)>& where) {
  FrameImages frame;
  frame.build_pyramid(image);

  auto keyframes = std::make_shared<KeyframeBlock>();
  keyframes->version = 1;
  keyframes->live = 1;
  keyframes->keyframes = {{KeyframeId{1}, view.camera_from_map, view.mean_depth}};

  auto map = std::make_shared<MapSnapshot>();
  map->map.bytes[0] = 1;
  map->epoch = Epoch{1};
  map->revision = Revision{1};
  map->keyframe_blocks = {keyframes};
  auto patches = std::make_shared<PatchBlock>();
  auto positions = std::make_shared<PositionBlock>();
  uint64_t next_id = 1;
  const auto finish_block = [&] {
    if (patches->points.empty()) return;
    patches->index = positions->index = static_cast<uint32_t>(map->point_blocks.size());
    map->point_blocks.push_back(make_point_block(patches, positions, map->keyframe_blocks));
    patches = std::make_shared<PatchBlock>();
    positions = std::make_shared<PositionBlock>();
  };
  for (int level = kPyramidLevels - 1; level >= 0; --level) {
    for (const Candidate& c : find_candidates(frame.pyramid.level(level), frame.corners(level))) {
      PointSource source = make_source(camera, view, level, c.corner, next_id);
      if (!cut_source_patch(frame.pyramid.level(level), c.corner, &source.pixels)) continue;
      ++next_id;
      const Eigen::Vector2d pixel(from_level(c.corner.x, level), from_level(c.corner.y, level));
      positions->live |= uint64_t{1} << patches->points.size();
      positions->positions.emplace_back(where(camera.unproject(pixel)).cast<float>());
      positions->visibility.emplace_back();
      patches->points.push_back(source);
      if (patches->points.size() == kBlockSlots) finish_block();
    }
  }
  finish_block();
  return map;
}

}  // namespace cairn::test
