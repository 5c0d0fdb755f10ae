// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/point_search.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace cairn {
namespace {

/// Spreads ids so that "the n smallest" is a stable, unbiased choice (Fibonacci hashing). Coarse points come
/// first, all that fit: they are few, and they steady the pose.
uint64_t rank_of(PointId id, bool is_coarse) {
  constexpr uint64_t kFine = uint64_t{1} << 63;
  return (id.value * 0x9E3779B97F4A7C15ULL) >> 1 | (is_coarse ? 0 : kFine);
}

FrustumOptions frustum_options(const PointSearchOptions& options) {
  FrustumOptions frustum = options.frustum;
  frustum.nearest = static_cast<float>(options.nearest);
  return frustum;
}

}  // namespace

PointSearch::PointSearch(CameraPtr camera, const PointSearchOptions& options)
    : camera_(std::move(camera)), options_(options), frustum_(*camera_, frustum_options(options)) {}

void PointSearch::use_camera(CameraPtr camera) {
  frustum_ = Frustum(*camera, frustum_options(options_));
  camera_ = std::move(camera);
}

void PointSearch::use_map(const MapSnapshotPtr& map) {
  if (!map_ || map_->map != map->map || map_->epoch != map->epoch) templates_.clear();
  map_ = map;
  templates_.resize(map->point_blocks.size());
}

void PointSearch::collect_candidates(const SE3& camera_from_map) {
  candidates_.clear();
  const auto focal_length = static_cast<float>(camera_->focal_length());
  for (size_t b = 0; b < map_->point_blocks.size(); ++b) {
    const PointBlock& block = *map_->point_blocks[b];
    const Eigen::Vector3f center = (camera_from_map * block.center.cast<double>()).cast<float>();
    if (block.live == 0 || !frustum_.may_hold(center, block.radius)) continue;
    const BlockView view = view_block(block, frustum_, camera_from_map, focal_length);
    for (uint64_t slots = view.slots; slots != 0; slots &= slots - 1) {
      const auto slot = static_cast<size_t>(std::countr_zero(slots));
      candidates_.push_back({rank_of(block.ids[slot], (view.coarse >> slot & 1) != 0),
                             {static_cast<int>(b), static_cast<int>(slot)}});
    }
  }
}

bool PointSearch::project(PointSlot slot, const SE3& camera_from_map, const Eigen::Matrix3d& rotation,
                          VisiblePoint* out) const {
  const PointBlock& block = *map_->point_blocks[static_cast<size_t>(slot.block)];
  const auto s = static_cast<size_t>(slot.slot);
  out->position = block.position(slot.slot);
  const Eigen::Vector3d in_camera = rotation * out->position + camera_from_map.translation();
  if (in_camera.z() < options_.nearest) return false;
  Matrix23d jacobian;
  const auto pixel = camera_->project(in_camera, &jacobian);
  if (!pixel || !camera_->in_image(*pixel)) return false;
  const Matrix23d by_map = jacobian * rotation;
  out->level0_from_source.col(0) = (by_map * block.right[s].cast<double>()).cast<float>();
  out->level0_from_source.col(1) = (by_map * block.down[s].cast<double>()).cast<float>();
  const auto level = warp_level(out->level0_from_source);
  if (!level) return false;
  out->id = block.ids[s];
  out->slot = slot;
  out->level = static_cast<uint8_t>(*level);
  out->expected = pixel->cast<float>();
  out->depth = static_cast<float>(in_camera.z());
  return true;
}

void PointSearch::find_visible(const SE3& camera_from_map, int max_points, std::vector<VisiblePoint>* out) {
  out->clear();
  for (auto& points : by_level_) points.clear();
  collect_candidates(camera_from_map);
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  const auto before = [](const Candidate& a, const Candidate& b) { return a.rank < b.rank; };
  const auto limit = static_cast<size_t>(max_points);
  size_t taken = 0;
  // In portions, as not every candidate can be used: a map in view may hold many times the points wanted.
  for (size_t next = 0; next < candidates_.size() && taken < limit;) {
    const size_t end = std::min(candidates_.size(), next + (limit - taken));
    const auto at = [this](size_t i) { return candidates_.begin() + static_cast<ptrdiff_t>(i); };
    if (end < candidates_.size()) std::nth_element(at(next), at(end), candidates_.end(), before);
    std::sort(at(next), at(end), before);
    for (; next < end; ++next) {
      VisiblePoint point;
      if (!project(candidates_[next].slot, camera_from_map, rotation, &point)) continue;
      by_level_[point.level].push_back(point);
      ++taken;
    }
  }
  for (auto points = by_level_.rbegin(); points != by_level_.rend(); ++points)
    out->insert(out->end(), points->begin(), points->end());
}

bool PointSearch::reproject(const SE3& camera_from_map, VisiblePoint* point) const {
  const Eigen::Vector3d in_camera = camera_from_map * point->position;
  if (in_camera.z() < options_.nearest) return false;
  const auto pixel = camera_->project(in_camera);
  if (!pixel || !camera_->in_image(*pixel)) return false;
  point->expected = pixel->cast<float>();
  point->depth = static_cast<float>(in_camera.z());
  return true;
}

const PatchTemplate* PointSearch::template_of(const VisiblePoint& point, const Smear& smear) {
  const PointBlock& shown = *map_->point_blocks[static_cast<size_t>(point.slot.block)];
  auto& block = templates_[static_cast<size_t>(point.slot.block)];
  const PointId first = shown.ids[0];
  if (!block || block->first != first) block = std::make_unique<CachedBlock>(CachedBlock{first, {}});
  return block->templates[static_cast<size_t>(point.slot.slot)].of(
      shown.source(point.slot.slot).pixels, point.level0_from_source, point.level, smear.at(point.expected),
      options_.templates);
}

void PointSearch::search(const FrameImages& frame, const SearchReach& reach, VisiblePoint* point) {
  point->found = false;
  const PatchTemplate* patch = template_of(*point, frame.smear);
  if (patch == nullptr) return;
  const int level = point->level;
  const GrayImage& image = frame.pyramid.level(level);
  const Eigen::Vector2f center(to_level(point->expected.x(), level), to_level(point->expected.y(), level));
  const float level_radius = std::max(options_.least_radius, reach.radius / static_cast<float>(1 << level));
  // Within the reach of the alignment it needs no corner: in a noisy image corners come and go, texture
  // stays.
  const bool is_near = level_radius <= options_.alignment_reach;
  auto refined = is_near && reach.by != SearchBy::kCorners
                     ? refine_patch(*patch, image, center, reach.iterations, level_radius)
                     : std::nullopt;
  if (!refined) {
    if (reach.by == (is_near ? SearchBy::kAlignment : SearchBy::kCorners)) return;
    refined = look_around(*patch, frame, center, level_radius, reach.iterations, options_.templates);
    if (!refined) return;
  }
  point->pixel = {from_level(refined->x(), level), from_level(refined->y(), level)};
  point->found = true;
}

}  // namespace cairn
