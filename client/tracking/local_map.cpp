// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/local_map.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace cairn {
namespace {

PointSource source_of(const LocalPoint& point, PointId id, KeyframeId keyframe, const SE3& camera_from_map) {
  const Eigen::Quaterniond& rotation = camera_from_map.rotation();
  const Eigen::Vector3d center = camera_from_map * point.position;
  PointSource source;
  source.id = id;
  source.keyframe = keyframe;
  source.level = point.level;
  source.ray_center = center.normalized().cast<float>();
  source.ray_right = (center + rotation * point.right).normalized().cast<float>();
  source.ray_down = (center + rotation * point.down).normalized().cast<float>();
  source.normal = (rotation * (point.seen_from - point.position).normalized()).cast<float>();
  source.pixels = point.pixels;
  return source;
}

/// Seen from these two places and nowhere else.
PointVisibility visibility_of(const Eigen::Vector3d& to_one, const Eigen::Vector3d& to_other) {
  const Eigen::Vector3d mean = (to_one.normalized() + to_other.normalized()).normalized();
  PointVisibility seen;
  seen.mean_direction = mean.cast<float>();
  seen.min_cosine = static_cast<float>(std::min(1.0, mean.dot(to_one.normalized())));
  seen.min_distance = static_cast<float>(std::min(to_one.norm(), to_other.norm()));
  seen.max_distance = static_cast<float>(std::max(to_one.norm(), to_other.norm()));
  return seen;
}

/// How far apart the keyframes that both maps have are in each [map units, RMS about their mean].
std::pair<double, double> extents(const MapSnapshot& one, const MapSnapshot& other) {
  std::vector<Eigen::Vector3d> in_one, in_other;
  for (const auto& block : one.keyframe_blocks) {
    for (const KeyframePose& k : block->keyframes) {
      const KeyframePose* same = other.find(k.id);
      if (same == nullptr || one.find(k.id) == nullptr) continue;
      in_one.push_back(k.camera_from_map.center());
      in_other.push_back(same->camera_from_map.center());
    }
  }
  const auto extent = [](const std::vector<Eigen::Vector3d>& centres) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& c : centres) mean += c / static_cast<double>(centres.size());
    double sum = 0;
    for (const Eigen::Vector3d& c : centres) sum += (c - mean).squaredNorm();
    return std::sqrt(sum / static_cast<double>(std::max<size_t>(1, centres.size())));
  };
  return {extent(in_one), extent(in_other)};
}

/// Whether lengths mean the same in two epochs of a map.
bool has_same_scale(const MapSnapshot& before, const MapSnapshot& now, double tolerance) {
  const auto [was, is] = extents(before, now);
  return was > 0 && std::abs(is / was - 1) < tolerance;
}

}  // namespace

void LocalMap::settle_in(MapId map) {
  if (base_ && base_->map != map) clear();
}

void LocalMap::clear() {
  keyframes_.clear();
  base_.reset();
  extended_.reset();
}

LocalMap::Keyframe* LocalMap::find(KeyframeId id) {
  const auto found = std::lower_bound(keyframes_.begin(), keyframes_.end(), id,
                                      [](const Keyframe& k, KeyframeId wanted) { return k.id < wanted; });
  return found != keyframes_.end() && found->id == id ? &*found : nullptr;
}

bool LocalMap::has_point(uint64_t number) const {
  return std::any_of(keyframes_.begin(), keyframes_.end(), [number](const Keyframe& k) {
    return std::any_of(k.blocks.begin(), k.blocks.end(), [number](const Block& block) {
      return std::find(block.numbers.begin(), block.numbers.end(), number) != block.numbers.end();
    });
  });
}

bool LocalMap::is_overdue() const {
  return std::any_of(keyframes_.begin(), keyframes_.end(), [&](const Keyframe& k) {
    return !k.answered && now_ - k.time >= options_.answer_awaited;
  });
}

bool LocalMap::has_room(Timestamp time) const {
  if (keyframes_.empty()) return true;
  return keyframes_.size() < options_.most_keyframes &&
         (!is_overdue() || time - keyframes_.back().time >= options_.spacing);
}

size_t LocalMap::point_count() const {
  size_t count = 0;
  for (const Keyframe& k : keyframes_) {
    for (const Block& block : k.blocks) count += block.numbers.size();
  }
  return count;
}

void LocalMap::propose(const KeyframeProposal& proposal, const SE3& camera_from_map, float mean_depth,
                       Timestamp time, std::span<const LocalPoint> points,
                       std::span<const LocalMeasurement> measurements) {
  if (keyframes_.size() >= options_.most_keyframes) return;
  Keyframe k;
  k.id = KeyframeId{kLocalBit | proposal.number};
  k.reference = proposal.reference;
  k.camera_from_reference = proposal.camera_from_reference;
  k.mean_depth = mean_depth;
  k.time = time;
  k.measurements.assign(measurements.begin(), measurements.end());
  add_points(camera_from_map, points, &k);
  keyframes_.push_back(std::move(k));
  if (keyframes_.size() > options_.most_measured)
    keyframes_[keyframes_.size() - 1 - options_.most_measured].measurements = {};
  drop_points_beyond_limit();
}

void LocalMap::add_points(const SE3& camera_from_map, std::span<const LocalPoint> points,
                          Keyframe* keyframe) {
  std::shared_ptr<PatchBlock> patches;
  for (const LocalPoint& p : points) {
    if (has_point(p.number)) continue;
    if (!patches || patches->points.size() == kBlockSlots) {
      patches = std::make_shared<PatchBlock>();
      keyframe->blocks.emplace_back().patches = patches;
    }
    const PointId id{kLocalBit | ++points_made_};
    patches->points.push_back(source_of(p, id, keyframe->id, camera_from_map));
    Block& block = keyframe->blocks.back();
    block.numbers.push_back(p.number);
    block.positions.push_back(camera_from_map * p.position);
    block.seen_from.push_back(camera_from_map * p.seen_from);
  }
}

/// Drops the points of the oldest keyframes first. The keyframes stay, since others hang on them.
void LocalMap::drop_points_beyond_limit() {
  size_t count = point_count();
  for (Keyframe& k : keyframes_) {
    if (count <= options_.most_points) return;
    for (const Block& block : k.blocks) count -= block.numbers.size();
    k.blocks.clear();
    extended_.reset();
  }
}

void LocalMap::answered(uint64_t number, std::optional<KeyframeId> keyframe) {
  Keyframe* k = find(KeyframeId{kLocalBit | number});
  if (k == nullptr || k->answered) return;
  k->answered = now_;
  k->became = keyframe.value_or(KeyframeId{});
  if (!keyframe) k->shown = now_;
  if (!k->counts) drop(static_cast<size_t>(k - keyframes_.data()));
}

/// Drops a keyframe. What hung on it hangs on the keyframe that it has become, or on the one that it hung on.
void LocalMap::drop(size_t i) {
  const Keyframe gone = std::move(keyframes_[i]);
  keyframes_.erase(keyframes_.begin() + static_cast<ptrdiff_t>(i));
  for (Keyframe& k : keyframes_) {
    if (k.reference != gone.id) continue;
    k.reference = gone.became ? gone.became : gone.reference;
    if (!gone.became) k.camera_from_reference = k.camera_from_reference * gone.camera_from_reference;
  }
  if (gone.counts) extended_.reset();
}

void LocalMap::advance(Timestamp time, std::vector<uint64_t>* counted) {
  now_ = time;
  for (size_t i = keyframes_.size(); i-- > 0;) {
    const Keyframe& k = keyframes_[i];
    const bool is_overtaken = k.answered && time - *k.answered >= options_.overtaken;
    if (is_overtaken || (k.shown && time - *k.shown >= options_.taken_over)) drop(i);
  }
  if (!is_overdue()) return;
  // The server is away: there is no use in waiting for what it says of the newer ones.
  for (Keyframe& k : keyframes_) {
    if (k.counts || k.answered) continue;
    k.counts = true;
    extended_.reset();
    for (const Block& block : k.blocks)
      counted->insert(counted->end(), block.numbers.begin(), block.numbers.end());
  }
}

/// Sets the poses of the keyframes in this revision. A keyframe that hangs on nothing that is left has none.
void LocalMap::aim(const MapSnapshot& map) {
  for (Keyframe& k : keyframes_) {
    const KeyframePose* became = k.became ? map.find(k.became) : nullptr;
    if (!k.shown && became != nullptr) k.shown = now_;
    k.has_pose = true;
    if (became != nullptr) {
      k.camera_from_map = became->camera_from_map;
    } else if (const Keyframe* local = find(k.reference); local != nullptr && local->has_pose) {
      k.camera_from_map = k.camera_from_reference * local->camera_from_map;
    } else if (const KeyframePose* reference = map.find(k.reference)) {
      k.camera_from_map = k.camera_from_reference * reference->camera_from_map;
    } else {
      k.has_pose = false;
    }
  }
}

void LocalMap::put_points(MapSnapshot* map) const {
  for (const Keyframe& k : keyframes_) {
    if (!k.counts || !k.has_pose) continue;
    const SE3 map_from_camera = k.camera_from_map.inverse();
    for (const Block& block : k.blocks) {
      auto placed = std::make_shared<PositionBlock>();
      placed->live = ~uint64_t{0} >> (kBlockSlots - block.positions.size());
      for (size_t i = 0; i < block.positions.size(); ++i) {
        const Eigen::Vector3d position = map_from_camera * block.positions[i];
        placed->positions.emplace_back(position.cast<float>());
        placed->visibility.push_back(visibility_of(map_from_camera.translation() - position,
                                                   map_from_camera * block.seen_from[i] - position));
      }
      map->point_blocks.push_back(make_point_block(block.patches, std::move(placed), map->keyframe_blocks));
    }
  }
}

MapSnapshotPtr LocalMap::extend(const MapSnapshotPtr& map) {
  if (keyframes_.empty()) base_.reset();
  if (base_ && base_->map != map->map) return map;
  if (base_ && base_->epoch != map->epoch && !has_same_scale(*base_, *map, options_.same_scale)) clear();
  if (base_ != map) extended_.reset();
  base_ = map;
  if (extended_) return extended_;
  aim(*map);
  const auto is_part = [](const Keyframe& k) { return k.counts && k.has_pose; };
  if (std::none_of(keyframes_.begin(), keyframes_.end(), is_part)) return extended_ = map;
  auto extended = std::make_shared<MapSnapshot>(*map);
  std::shared_ptr<KeyframeBlock> block;
  for (const Keyframe& k : keyframes_) {
    if (!is_part(k)) continue;
    if (!block || block->keyframes.size() == kBlockSlots) {
      block = std::make_shared<KeyframeBlock>();
      extended->keyframe_blocks.push_back(block);
    }
    block->live |= uint64_t{1} << block->keyframes.size();
    block->keyframes.push_back({k.id, k.camera_from_map, k.mean_depth});
  }
  put_points(extended.get());
  return extended_ = std::move(extended);
}

}  // namespace cairn
