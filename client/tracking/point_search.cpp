// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/point_search.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace cairn {
namespace {

constexpr double kNearest = 1e-3;         // ptam.md 5: in front of the camera [map unit]
constexpr float kTemplateChange = 0.07F;  // ptam.md 6: a warp column [search-level px per source px]
constexpr float kAlignmentReach =
    5.0F;  // [search-level px] radius up to which alignment is tried from where it is expected
/// A point may be seen from this much farther round, nearer and farther than any keyframe has seen it;
/// beyond, its patch is not expected to match. 35 degrees, factors of 2.
constexpr float kExtraAngle = 35.0F * 3.14159265F / 180.0F;
constexpr float kNearer = 0.5F;
constexpr float kFarther = 2.0F;

/// Spreads ids so that "the n smallest" is a stable, unbiased choice (Fibonacci hashing).
uint64_t priority(PointId id) {
  return id.value * 0x9E3779B97F4A7C15ULL;
}

bool can_be_seen(const PointVisibility& seen, const Eigen::Vector3f& to_camera) {
  const float distance = to_camera.norm();
  if (seen.max_distance > 0 &&
      (distance < kNearer * seen.min_distance || distance > kFarther * seen.max_distance)) {
    return false;
  }
  if (seen.mean_direction.isZero()) return true;
  const float angle = std::acos(std::clamp(seen.mean_direction.dot(to_camera) / distance, -1.0F, 1.0F));
  return angle <= std::acos(std::clamp(seen.min_cosine, -1.0F, 1.0F)) + kExtraAngle;
}

}  // namespace

PointSearch::PointSearch(CameraPtr camera) {
  use_camera(std::move(camera));
}

void PointSearch::use_camera(CameraPtr camera) {
  camera_ = std::move(camera);
  view_half_angle_ = 0;
  for (const double x : {0.0, camera_->width() - 1.0}) {
    for (const double y : {0.0, camera_->height() - 1.0}) {
      const Eigen::Vector3d ray = camera_->unproject({x, y});
      view_half_angle_ = std::max(view_half_angle_, std::acos(std::clamp(ray.z(), -1.0, 1.0)));
    }
  }
}

void PointSearch::use_map(const MapSnapshotPtr& map) {
  if (!map_ || map_->map != map->map || map_->epoch != map->epoch) templates_.clear();
  map_ = map;
  templates_.resize(map->point_blocks.size());
}

bool PointSearch::block_in_view(const PointBlock& block, const SE3& camera_from_map) const {
  const Eigen::Vector3d center = camera_from_map * block.center.cast<double>();
  const double distance = center.norm();
  if (distance <= block.radius) return true;
  const double angle = std::atan2(center.head<2>().norm(), center.z());
  return angle - std::asin(std::min(1.0, block.radius / distance)) <= view_half_angle_;
}

void PointSearch::project_block(const PointBlock& block, int block_index, const SE3& camera_from_map,
                                std::vector<VisiblePoint>* out) const {
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  const Eigen::Vector3f camera_center = camera_from_map.center().cast<float>();
  for (uint64_t live = block.live(); live != 0; live &= live - 1) {
    const int slot = std::countr_zero(live);
    const auto s = static_cast<size_t>(slot);
    const Eigen::Vector3d position = block.position(slot);
    const Eigen::Vector3d in_camera = rotation * position + camera_from_map.translation();
    if (in_camera.z() < kNearest) continue;
    Matrix23d jacobian;
    const auto pixel = camera_->project(in_camera, &jacobian);
    if (!pixel || !camera_->in_image(*pixel)) continue;
    if (!can_be_seen(block.visibility(slot), camera_center - position.cast<float>())) continue;

    const Matrix23d by_map = jacobian * rotation;
    Warp warp;
    warp.col(0) = (by_map * block.right[s].cast<double>()).cast<float>();
    warp.col(1) = (by_map * block.down[s].cast<double>()).cast<float>();
    const auto level = warp_level(warp);
    if (!level) continue;
    VisiblePoint& point = out->emplace_back();
    point.id = block.source(slot).id;
    point.slot = {block_index, slot};
    point.level = static_cast<uint8_t>(*level);
    point.position = position;
    point.expected = pixel->cast<float>();
    point.level0_from_source = warp;
    point.depth = static_cast<float>(in_camera.z());
  }
}

void PointSearch::find_visible(const SE3& camera_from_map, int max_points, std::vector<VisiblePoint>* out) {
  out->clear();
  for (size_t b = 0; b < map_->point_blocks.size(); ++b) {
    const PointBlock& block = *map_->point_blocks[b];
    if (block.live() == 0 || !block_in_view(block, camera_from_map)) continue;
    project_block(block, static_cast<int>(b), camera_from_map, out);
  }
  // Coarse points first, all that fit: they are few, and they steady the pose; then a stable choice of the
  // finer ones.
  const auto before = [](const VisiblePoint& a, const VisiblePoint& b) {
    const bool a_coarse = a.level >= 2;
    const bool b_coarse = b.level >= 2;
    if (a_coarse != b_coarse) return a_coarse;
    return priority(a.id) < priority(b.id);
  };
  const auto limit = static_cast<size_t>(max_points);
  if (out->size() > limit) {
    std::nth_element(out->begin(), out->begin() + static_cast<ptrdiff_t>(limit), out->end(), before);
    out->resize(limit);
  }
  std::sort(out->begin(), out->end(), [](const VisiblePoint& a, const VisiblePoint& b) {
    return a.level != b.level ? a.level > b.level : priority(a.id) < priority(b.id);
  });
}

bool PointSearch::reproject(const SE3& camera_from_map, VisiblePoint* point) const {
  const Eigen::Vector3d in_camera = camera_from_map * point->position;
  if (in_camera.z() < kNearest) return false;
  const auto pixel = camera_->project(in_camera);
  if (!pixel || !camera_->in_image(*pixel)) return false;
  point->expected = pixel->cast<float>();
  point->depth = static_cast<float>(in_camera.z());
  return true;
}

const PatchTemplate* PointSearch::template_of(const VisiblePoint& point) {
  auto& block = templates_[static_cast<size_t>(point.slot.block)];
  if (!block) block = std::make_unique<CachedBlock>();
  CachedTemplate& cached = (*block)[static_cast<size_t>(point.slot.slot)];
  const float limit = kTemplateChange * static_cast<float>(1 << point.level);
  if (cached.valid && cached.patch.level == point.level &&
      (cached.warp - point.level0_from_source).colwise().norm().maxCoeff() <= limit) {
    return &cached.patch;
  }
  const PointSource& source =
      map_->point_blocks[static_cast<size_t>(point.slot.block)]->source(point.slot.slot);
  cached.valid = make_template(source.pixels, point.level0_from_source, point.level, &cached.patch);
  cached.warp = point.level0_from_source;
  return cached.valid ? &cached.patch : nullptr;
}

void PointSearch::search(const FrameImages& frame, float radius, int refine_iterations, VisiblePoint* point) {
  point->searched = true;
  point->found = false;
  const PatchTemplate* patch = template_of(*point);
  if (patch == nullptr) return;
  const int level = point->level;
  const GrayImage& image = frame.pyramid.level(level);
  const Eigen::Vector2f center(to_level(point->expected.x(), level), to_level(point->expected.y(), level));
  const float level_radius = std::max(1.5F, radius / static_cast<float>(1 << level));
  // Within the reach of the alignment it needs no corner: in a noisy picture corners come and go, texture
  // stays.
  auto refined = level_radius <= kAlignmentReach
                     ? refine_patch(*patch, image, center, refine_iterations, level_radius)
                     : std::nullopt;
  if (!refined) {
    const auto match =
        find_patch(*patch, image, frame.corners[static_cast<size_t>(level)], center, level_radius);
    if (!match) return;
    refined =
        refine_patch(*patch, image, Eigen::Vector2f(match->corner.x, match->corner.y), refine_iterations);
    if (!refined) return;
  }
  point->pixel = {from_level(refined->x(), level), from_level(refined->y(), level)};
  point->found = true;
}

}  // namespace cairn
