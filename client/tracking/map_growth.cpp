// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/map_growth.h"

#include <array>

#include "common/geometry/view_span.h"
#include "common/image/known_area.h"
#include "common/image/patch_border.h"

namespace cairn {

bool widens_map(const MapSnapshot& map, const Eigen::Vector3d& center, double mean_depth) {
  std::array<Eigen::Vector3d, kMostYoungViews> centers;
  size_t count = 0;
  for (const auto& block : map.keyframe_blocks) {
    for (size_t slot = 0; slot < block->keyframes.size(); ++slot) {
      if ((block->live >> slot & 1) == 0) continue;
      if (count == centers.size()) return false;
      centers[count++] = block->keyframes[slot].camera_from_map.center();
    }
  }
  return widens_young_map(std::span(centers).first(count), center, mean_depth);
}

bool shows_new_area(const FrameImages& frame, std::span<const VisiblePoint> points,
                    const KeyframePolicyOptions& options, StageProbe* probe) {
  const ScopedStage stage(probe, Stage::kCorners);
  const int level = options.area_level;
  const GrayView& image = frame.pyramid.level(level);
  KnownArea area(image.width, image.height);
  for (const Candidate& c :
       find_candidates(image, frame.corners(level), options.area_barrier, kPatchBorder, options.area_texture))
    area.add_corner(c.corner.x, c.corner.y);
  for (const VisiblePoint& p : points) {
    if (p.found) area.add_measurement(to_level(p.pixel.x(), level), to_level(p.pixel.y(), level));
  }
  return area.unknown_fraction() >= KnownArea::kNewAreaFraction;
}

}  // namespace cairn
