// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/expected_points.h"

#include <algorithm>

#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

constexpr double kNearest =
    1e-3;  ///< in front of the camera [map unit]: no option, it only keeps a division sound

struct Projected {
  const PointBlock* block = nullptr;
  int slot = 0;
  PatchView view;
  double depth = 0;
};

bool is_seen_from_alike(const MapSnapshot& map, const PointSource& source, const Eigen::Vector3d& point,
                        const Eigen::Vector3d& camera_center, double visible_cosine) {
  const KeyframePose* keyframe = map.find(source.keyframe);
  if (keyframe == nullptr) return true;  // it has been removed, and the patch stays
  const Eigen::Vector3d to_source = keyframe->camera_from_map.center() - point;
  const Eigen::Vector3d to_camera = camera_center - point;
  return to_source.dot(to_camera) > visible_cosine * to_source.norm() * to_camera.norm();
}

std::optional<Projected> project(const MapSnapshot& map, const PointBlock& block, int slot,
                                 const Camera& camera, const SE3& camera_from_map,
                                 const RefindOptions& options) {
  const Eigen::Vector3d point = block.position(slot);
  const Eigen::Vector3d in_camera = camera_from_map * point;
  if (in_camera.z() < kNearest) return std::nullopt;
  Matrix23d jacobian;
  const auto pixel = camera.project(in_camera, &jacobian);
  if (!pixel || !camera.in_image(*pixel)) return std::nullopt;
  if (!is_seen_from_alike(map, block.source(slot), point, camera_from_map.center(), options.visible_cosine))
    return std::nullopt;
  const Matrix23d by_map = jacobian * camera_from_map.rotation_matrix();
  const auto s = static_cast<size_t>(slot);
  Projected candidate{&block, slot, {}, in_camera.z()};
  candidate.view.pixel = *pixel;
  candidate.view.warp.col(0) = (by_map * block.right[s].cast<double>()).cast<float>();
  candidate.view.warp.col(1) = (by_map * block.down[s].cast<double>()).cast<float>();
  const auto level = warp_level(candidate.view.warp);
  if (!level || !camera.in_image(*pixel, options.image_border * (1 << *level))) return std::nullopt;
  candidate.view.level = *level;
  return candidate;
}

}  // namespace

std::vector<ExpectedPoint> expected_points(const MapSnapshot& map, const Camera& camera,
                                           const SE3& camera_from_map, const KeyframeImages& images,
                                           const StillMaskPtr& still, size_t most,
                                           const RefindOptions& options) {
  std::vector<Projected> candidates;
  for (const auto& block : map.point_blocks) {
    for (int slot = 0; slot < block->count; ++slot) {
      if ((block->live >> slot & 1) == 0) continue;
      auto candidate = project(map, *block, slot, camera, camera_from_map, options);
      if (candidate && !(still && still->covers(candidate->view.pixel.cast<float>())))
        candidates.push_back(*candidate);
    }
  }
  std::vector<ExpectedPoint> points;
  points.reserve(std::min(most, candidates.size()));
  for (size_t i = 0; i < candidates.size(); ++i) {
    // Every so many-th of them.
    if (candidates.size() > most && i * most / candidates.size() == (i + 1) * most / candidates.size())
      continue;
    const Projected& c = candidates[i];
    const auto found = find_near_corner(c.block->source(c.slot), c.view, images, options.radius);
    points.push_back({c.block->ids[static_cast<size_t>(c.slot)], found.has_value(),
                      found ? found->pixel : c.view.pixel.cast<float>(), c.depth});
  }
  return points;
}

}  // namespace cairn
