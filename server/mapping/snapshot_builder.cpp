// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/snapshot_builder.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cairn {
namespace {

/// First and one-past-last item of a block.
std::pair<size_t, size_t> block_range(size_t block, size_t items) {
  return {block * kBlockSlots, std::min(items, (block + 1) * kBlockSlots)};
}

KeyframePose published_pose(const MapKeyframe& k) {
  return {k.id, k.camera_from_map, static_cast<float>(k.mean_depth)};
}

bool moved_visibly(const MapKeyframe& k, const KeyframePose& before, double visible_move) {
  const Vector6d change = (k.camera_from_map * before.camera_from_map.inverse()).log();
  const double depth = std::max(k.mean_depth, 1e-9);
  return (change.head<3>().norm() / depth + change.tail<3>().norm()) * k.camera->focal_length() >
         visible_move;
}

/// Camera centres, indexed by keyframe id - 1.
using Centers = std::vector<Eigen::Vector3d>;

Centers camera_centers(const MapState& map) {
  Centers centers;
  centers.reserve(map.keyframes().size());
  for (const MapKeyframe& k : map.keyframes()) centers.push_back(k.camera_from_map.center());
  return centers;
}

PointVisibility visibility_of(const Centers& centers, const MapPoint& point) {
  PointVisibility v;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = 0;
  for (const KeyframeId id : point.observers) {
    const Eigen::Vector3d d = centers[id.value - 1] - point.position;
    const double distance = d.norm();
    sum += d.normalized();  // of a point where a camera is, nothing
    nearest = std::min(nearest, distance);
    farthest = std::max(farthest, distance);
  }
  if (point.observers.empty() || sum.norm() < 1e-6) return v;
  const Eigen::Vector3d mean = sum.normalized();
  double cosine = 1;
  for (const KeyframeId id : point.observers) {
    cosine = std::min(cosine, mean.dot((centers[id.value - 1] - point.position).normalized()));
  }
  v.mean_direction = mean.cast<float>();
  v.min_cosine = static_cast<float>(cosine);
  v.min_distance = static_cast<float>(nearest);
  v.max_distance = static_cast<float>(farthest);
  return v;
}

bool changed_notably(const PointVisibility& now, const PointVisibility& before,
                     const PublicationOptions& options) {
  return (now.mean_direction - before.mean_direction).norm() > options.visible_turn ||
         std::abs(now.min_cosine - before.min_cosine) > options.visible_turn ||
         std::abs(now.min_distance - before.min_distance) > options.visible_distance * before.min_distance ||
         std::abs(now.max_distance - before.max_distance) > options.visible_distance * before.max_distance;
}

bool moved_visibly(const MapState& map, const Centers& centers, const MapPoint& point,
                   const Eigen::Vector3f& before, double visible_move) {
  const KeyframeId source = point.source->keyframe;
  const double distance = (centers[source.value - 1] - point.position).norm();
  return (point.position - before.cast<double>()).norm() * map.keyframe(source).camera->focal_length() >
         visible_move * distance;
}

uint64_t live_bit(bool live, size_t slot) {
  return live ? uint64_t{1} << slot : 0;
}

std::shared_ptr<const KeyframeBlock> cut_keyframes(const MapState& map, size_t index, uint64_t version) {
  auto block = std::make_shared<KeyframeBlock>();
  block->index = static_cast<uint32_t>(index);
  block->version = version;
  const auto [begin, end] = block_range(index, map.keyframes().size());
  for (size_t i = begin; i < end; ++i) {
    block->keyframes.push_back(published_pose(map.keyframes()[i]));
    block->live |= live_bit(map.keyframes()[i].live, i - begin);
  }
  return block;
}

bool is_current(const MapState& map, const KeyframeBlock& block, const PublicationOptions& options) {
  const auto [begin, end] = block_range(block.index, map.keyframes().size());
  if (end - begin != block.keyframes.size()) return false;
  for (size_t i = begin; i < end; ++i) {
    const MapKeyframe& k = map.keyframes()[i];
    if (live_bit(k.live, i - begin) != (block.live & live_bit(true, i - begin))) return false;
    if (k.live && moved_visibly(k, block.keyframes[i - begin], options.visible_move)) return false;
  }
  return true;
}

std::shared_ptr<const PatchBlock> cut_patches(const MapState& map, size_t index, uint64_t version) {
  auto block = std::make_shared<PatchBlock>();
  block->index = static_cast<uint32_t>(index);
  block->version = version;
  const auto [begin, end] = block_range(index, map.points().size());
  block->points.reserve(end - begin);
  for (size_t i = begin; i < end; ++i) block->points.push_back(source_in_block(map.points()[i]));
  return block;
}

std::shared_ptr<const PositionBlock> cut_positions(const MapState& map, const Centers& centers, size_t index,
                                                   uint64_t version) {
  auto block = std::make_shared<PositionBlock>();
  block->index = static_cast<uint32_t>(index);
  block->version = version;
  const auto [begin, end] = block_range(index, map.points().size());
  for (size_t i = begin; i < end; ++i) {
    const MapPoint& p = map.points()[i];
    block->positions.push_back(p.position.cast<float>());
    block->visibility.push_back(visibility_of(centers, p));
    block->live |= live_bit(p.live, i - begin);
  }
  return block;
}

/// Whether a published patch block still describes its points. What a patch shows never changes: a block is
/// only ever completed, or aimed for another camera.
bool is_current(const MapState& map, const PatchBlock& block) {
  const auto [begin, end] = block_range(block.index, map.points().size());
  if (end - begin != block.points.size()) return false;
  for (size_t i = begin; i < end; ++i) {
    const auto& source = map.points()[i].source;
    const PointSource& published = block.points[i - begin];
    if (source && (source->ray_center != published.ray_center || source->ray_right != published.ray_right ||
                   source->ray_down != published.ray_down || source->normal != published.normal))
      return false;
  }
  return true;
}

bool is_current(const MapState& map, const Centers& centers, const PositionBlock& block,
                const PublicationOptions& options) {
  const auto [begin, end] = block_range(block.index, map.points().size());
  if (end - begin != block.positions.size()) return false;
  for (size_t i = begin; i < end; ++i) {
    const MapPoint& p = map.points()[i];
    const size_t slot = i - begin;
    if (live_bit(p.live, slot) != (block.live & live_bit(true, slot))) return false;
    if (!p.live) continue;
    if (moved_visibly(map, centers, p, block.positions[slot], options.visible_move)) return false;
    if (changed_notably(visibility_of(centers, p), block.visibility[slot], options)) return false;
  }
  return true;
}

/// Whether each keyframe's pose differs visibly from the one published before, indexed by id - 1; for removed
/// ones the value has no meaning.
std::vector<bool> moved_sources(const std::vector<std::shared_ptr<const KeyframeBlock>>& now,
                                const std::vector<std::shared_ptr<const KeyframeBlock>>& before,
                                const MapState& map, double visible_move) {
  std::vector<bool> moved(map.keyframes().size(), true);
  for (size_t b = 0; b < before.size(); ++b) {
    for (size_t s = 0; s < before[b]->keyframes.size(); ++s) {
      const size_t i = b * kBlockSlots + s;
      const MapKeyframe& k = map.keyframes()[i];
      moved[i] = now[b] != before[b] && k.live && moved_visibly(k, before[b]->keyframes[s], visible_move);
    }
  }
  return moved;
}

}  // namespace

MapSnapshotPtr SnapshotBuilder::build(const MapState& map) {
  auto next = std::make_shared<MapSnapshot>();
  next->map = map_;
  next->name = name_;
  next->epoch = epoch_;
  next->revision = Revision{previous_ ? previous_->revision.value + 1 : 1};
  const uint64_t version = next->revision.value;
  for (const MapCamera& c : map.cameras()) next->cameras.push_back(c.version);
  bool changed = !previous_ || previous_->name != name_ || previous_->cameras != next->cameras;

  for (size_t b = 0; b < block_count(map.keyframes().size()); ++b) {
    const bool keep = previous_ && b < previous_->keyframe_blocks.size() &&
                      is_current(map, *previous_->keyframe_blocks[b], options_);
    next->keyframe_blocks.push_back(keep ? previous_->keyframe_blocks[b] : cut_keyframes(map, b, version));
    changed |= !keep;
  }
  const std::vector<bool> moved = moved_sources(
      next->keyframe_blocks,
      previous_ ? previous_->keyframe_blocks : std::vector<std::shared_ptr<const KeyframeBlock>>{}, map,
      options_.visible_move);
  const Centers centers = camera_centers(map);
  for (size_t b = 0; b < block_count(map.points().size()); ++b) {
    const PointBlock* before =
        previous_ && b < previous_->point_blocks.size() ? previous_->point_blocks[b].get() : nullptr;
    const auto [begin, end] = block_range(b, map.points().size());
    const bool keep_patches = before && is_current(map, *before->patches);
    const bool keep_positions = before && is_current(map, centers, *before->positions, options_);
    bool source_moved = false;
    for (size_t i = begin; i < end; ++i) {
      const auto& source = map.points()[i].source;
      source_moved |= source && moved[source->keyframe.value - 1];
    }
    if (keep_patches && keep_positions && !source_moved) {
      next->point_blocks.push_back(previous_->point_blocks[b]);
      continue;
    }
    changed = true;
    next->point_blocks.push_back(make_point_block(
        keep_patches ? before->patches : cut_patches(map, b, version),
        keep_positions ? before->positions : cut_positions(map, centers, b, version), next->keyframe_blocks));
  }
  if (changed) previous_ = std::move(next);
  return previous_;
}

}  // namespace cairn
