// SPDX-License-Identifier: Apache-2.0
#include "common/map/snapshot.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace cairn {
namespace {

/// Below this cosine between a ray and the patch's normal the plane is edge-on: one pixel would span twenty
/// and more.
constexpr float kMinPlaneCosine = 0.05F;

constexpr uint64_t bit_of(size_t slot) {
  return uint64_t{1} << slot;
}
bool is_live(uint64_t live, size_t slot) {
  return (live & bit_of(slot)) != 0;
}

template <typename Item, typename Id>
const Item* find_by_id(const std::vector<Item>& ascending, Id id) {
  const auto it = std::lower_bound(ascending.begin(), ascending.end(), id,
                                   [](const Item& item, Id wanted) { return item.id < wanted; });
  return it != ascending.end() && it->id == id ? &*it : nullptr;
}

struct KeyframeSlot {
  const KeyframePose* pose = nullptr;
  bool live = false;
};

/// Slot of a keyframe, live or removed; null pose when it never was in these blocks.
KeyframeSlot find_keyframe(const std::vector<std::shared_ptr<const KeyframeBlock>>& blocks, KeyframeId id) {
  const auto block = std::partition_point(blocks.begin(), blocks.end(), [id](const auto& b) {
    return !b->keyframes.empty() && b->keyframes.back().id < id;
  });
  if (block == blocks.end()) return {};
  const KeyframePose* pose = find_by_id((*block)->keyframes, id);
  if (pose == nullptr) return {};
  return {pose, is_live((*block)->live, static_cast<size_t>(pose - (*block)->keyframes.data()))};
}

/// One source-level pixel to the right and one down, laid onto the patch's plane; map frame.
struct PixelVectors {
  Eigen::Vector3f right;
  Eigen::Vector3f down;
};

/// Intersects the three rays with the plane through `position`. Differences are taken from where the centre
/// ray meets the plane, not from `position`: an adjusted point need not lie on its source ray, and its
/// texture does not shear for that.
std::optional<PixelVectors> pixel_vectors(const PointSource& source, const Eigen::Vector3f& position,
                                          const SE3& camera_from_map) {
  const Eigen::Vector3d in_camera = camera_from_map * position.cast<double>();
  const Eigen::Vector3d normal = source.normal.cast<double>();
  const double plane = normal.dot(in_camera);
  const auto on_plane = [&](const Eigen::Vector3f& ray_in) -> std::optional<Eigen::Vector3d> {
    const Eigen::Vector3d ray = ray_in.cast<double>();
    const double cosine = -normal.dot(ray);
    if (!(cosine > kMinPlaneCosine) || !(plane < 0)) return std::nullopt;
    return ray * (-plane / cosine);
  };
  const auto center = on_plane(source.ray_center);
  const auto right = on_plane(source.ray_right);
  const auto down = on_plane(source.ray_down);
  if (!center || !right || !down) return std::nullopt;
  const Eigen::Quaterniond map_from_camera = camera_from_map.rotation().conjugate();
  const PixelVectors vectors = {(map_from_camera * (*right - *center)).cast<float>(),
                                (map_from_camera * (*down - *center)).cast<float>()};
  if (!vectors.right.allFinite() || !vectors.down.allFinite()) return std::nullopt;
  return vectors;
}

void put_vectors(const PixelVectors& vectors, size_t slot, PointBlock* block) {
  block->right[slot] = vectors.right;
  block->down[slot] = vectors.down;
  const Eigen::Vector3f span = vectors.right.cross(vectors.down);
  block->span_x[slot] = span.x();
  block->span_y[slot] = span.y();
  block->span_z[slot] = span.z();
}

void put_visibility(const PointVisibility& seen, size_t slot, PointBlock* block) {
  block->view_x[slot] = seen.mean_direction.x();
  block->view_y[slot] = seen.mean_direction.y();
  block->view_z[slot] = seen.mean_direction.z();
  const float cosine = seen.mean_direction.isZero() ? -1.0F : std::clamp(seen.min_cosine, -1.0F, 1.0F);
  block->view_cosine[slot] = cosine;
  block->view_sine[slot] = std::sqrt(1 - cosine * cosine);
  const bool is_known = seen.max_distance > 0;
  block->nearest[slot] = is_known ? seen.min_distance : 0.0F;
  block->farthest[slot] = is_known ? seen.max_distance : std::numeric_limits<float>::infinity();
}

/// Sphere about the centre of the live points' bounding box.
void bound_live_points(PointBlock* block) {
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::max());
  Eigen::Vector3f high = -low;
  const auto for_each_live = [&](auto&& visit) {
    for (size_t s = 0; s < static_cast<size_t>(block->count); ++s) {
      if (is_live(block->live, s)) visit(Eigen::Vector3f(block->x[s], block->y[s], block->z[s]));
    }
  };
  if (block->live == 0) return;
  for_each_live([&](const Eigen::Vector3f& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  });
  block->center = 0.5F * (low + high);
  for_each_live(
      [&](const Eigen::Vector3f& p) { block->radius = std::max(block->radius, (p - block->center).norm()); });
}

}  // namespace

std::optional<PointSlot> MapSnapshot::find(PointId id) const {
  const auto block = std::partition_point(point_blocks.begin(), point_blocks.end(), [id](const auto& b) {
    return !b->patches->points.empty() && b->patches->points.back().id < id;
  });
  if (block == point_blocks.end()) return std::nullopt;
  const std::vector<PointSource>& points = (*block)->patches->points;
  const PointSource* point = find_by_id(points, id);
  if (point == nullptr) return std::nullopt;
  const int slot = static_cast<int>(point - points.data());
  if (slot >= (*block)->count || !is_live((*block)->live, static_cast<size_t>(slot))) return std::nullopt;
  return PointSlot{static_cast<int>(block - point_blocks.begin()), slot};
}

const KeyframePose* MapSnapshot::find(KeyframeId id) const {
  const KeyframeSlot slot = find_keyframe(keyframe_blocks, id);
  return slot.live ? slot.pose : nullptr;
}

const KeyframePose* MapSnapshot::nearest_keyframe(const Eigen::Vector3d& center) const {
  const KeyframePose* nearest = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const auto& block : keyframe_blocks) {
    for (size_t s = 0; s < block->keyframes.size(); ++s) {
      if (!is_live(block->live, s)) continue;
      const double distance = (block->keyframes[s].camera_from_map.center() - center).squaredNorm();
      if (distance < least) {
        least = distance;
        nearest = &block->keyframes[s];
      }
    }
  }
  return nearest;
}

size_t MapSnapshot::point_count() const {
  size_t count = 0;
  for (const auto& block : point_blocks) count += static_cast<size_t>(std::popcount(block->live));
  return count;
}

size_t MapSnapshot::keyframe_count() const {
  size_t count = 0;
  for (const auto& block : keyframe_blocks) count += static_cast<size_t>(std::popcount(block->live));
  return count;
}

std::shared_ptr<const PointBlock> make_point_block(
    std::shared_ptr<const PatchBlock> patches, std::shared_ptr<const PositionBlock> positions,
    const std::vector<std::shared_ptr<const KeyframeBlock>>& keyframes) {
  auto block = std::make_shared<PointBlock>();
  const size_t count = std::min({patches->points.size(), positions->positions.size(),
                                 positions->visibility.size(), static_cast<size_t>(kBlockSlots)});
  block->count = static_cast<int>(count);
  block->right.fill(Eigen::Vector3f::Zero());
  block->down.fill(Eigen::Vector3f::Zero());
  uint64_t live = 0;
  for (size_t s = 0; s < count; ++s) {
    const Eigen::Vector3f& position = positions->positions[s];
    block->x[s] = position.x();
    block->y[s] = position.y();
    block->z[s] = position.z();
    block->ids[s] = patches->points[s].id;
    put_visibility(positions->visibility[s], s, block.get());
    if (!is_live(positions->live, s)) continue;
    const KeyframePose* source = find_keyframe(keyframes, patches->points[s].keyframe).pose;
    if (source == nullptr) continue;
    const auto vectors = pixel_vectors(patches->points[s], position, source->camera_from_map);
    if (!vectors) continue;
    put_vectors(*vectors, s, block.get());
    live |= bit_of(s);
  }
  block->live = live;
  bound_live_points(block.get());
  block->patches = std::move(patches);
  block->positions = std::move(positions);
  return block;
}

}  // namespace cairn
