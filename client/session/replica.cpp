// SPDX-License-Identifier: Apache-2.0
#include "client/session/replica.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

/// Takes a block unless the one in place is newer (a resent history may come after newer values).
template <typename Block>
void keep_newest(std::shared_ptr<const Block>* place, Block block) {
  if (*place != nullptr && (*place)->version >= block.version) return;
  *place = std::make_shared<const Block>(std::move(block));
}

}  // namespace

bool Replica::enter_epoch(MapId map, Epoch epoch) {
  if (map != map_ || epoch < epoch_) return false;
  if (epoch > epoch_) {
    epoch_ = epoch;
    staged_points_.clear();
    staged_keyframes_.clear();
    pending_.reset();
    overtaken_since_.reset();
  }
  return true;
}

void Replica::receive(wire::PointPatches message) {
  if (!enter_epoch(message.map, message.epoch)) return;
  keep_newest(&staged_points_[message.block.index].patches, std::move(message.block));
}

void Replica::receive(wire::PointPositions message) {
  if (!enter_epoch(message.map, message.epoch)) return;
  keep_newest(&staged_points_[message.block.index].positions, std::move(message.block));
}

void Replica::receive(wire::KeyframePoses message) {
  if (!enter_epoch(message.map, message.epoch)) return;
  keep_newest(&staged_keyframes_[message.block.index], std::move(message.block));
}

void Replica::receive(wire::MapCommit message) {
  if (!enter_epoch(message.map, message.epoch)) return;
  if (pending_ && message.revision <= pending_->revision) return;
  if (snapshot_ != nullptr && snapshot_->epoch == message.epoch && message.revision <= snapshot_->revision)
    return;
  pending_ = std::move(message);
}

Replica::Standing Replica::standing() const {
  Standing standing;
  const auto compare = [&standing](const auto& block, uint64_t listed) {
    if (block == nullptr || block->version < listed) {
      standing.whole = false;
    } else if (block->version > listed) {
      standing.overtaken = true;
    }
  };
  for (const wire::BlockVersion& listed : pending_->points) {
    const auto it = staged_points_.find(listed.index);
    const PointParts parts = it == staged_points_.end() ? PointParts{} : it->second;
    compare(parts.patches, listed.patches);
    compare(parts.positions, listed.positions);
    // Overtaken by one topic only, the halves of a block may be of different lengths: they do not belong
    // together.
    if (parts.patches != nullptr && parts.positions != nullptr &&
        parts.patches->points.size() != parts.positions->positions.size()) {
      standing.whole = false;
    }
  }
  for (size_t index = 0; index < pending_->keyframe_versions.size(); ++index) {
    const auto it = staged_keyframes_.find(static_cast<uint32_t>(index));
    compare(it == staged_keyframes_.end() ? nullptr : it->second, pending_->keyframe_versions[index]);
  }
  return standing;
}

bool Replica::update(MonotonicTime now) {
  deadline_.reset();
  if (!pending_) return false;
  const Standing state = standing();
  if (state.overtaken && !overtaken_since_) overtaken_since_ = now;
  if (!state.whole) return false;
  if (state.overtaken && now - *overtaken_since_ < kOvertakenLimit) {
    deadline_ = *overtaken_since_ + kOvertakenLimit;
    return false;
  }
  swap();
  return true;
}

std::set<KeyframeId> Replica::moved_keyframes(
    const std::vector<std::shared_ptr<const KeyframeBlock>>& keyframes) const {
  std::set<KeyframeId> moved;
  if (snapshot_ == nullptr) return moved;
  const auto& before = snapshot_->keyframe_blocks;
  for (size_t b = 0; b < keyframes.size(); ++b) {
    if (b < before.size() && before[b] == keyframes[b]) continue;
    for (size_t slot = 0; slot < keyframes[b]->keyframes.size(); ++slot) {
      const KeyframePose& pose = keyframes[b]->keyframes[slot];
      const bool same =
          b < before.size() && slot < before[b]->keyframes.size() && before[b]->keyframes[slot] == pose;
      if (!same) moved.insert(pose.id);
    }
  }
  return moved;
}

void Replica::swap() {
  auto next = std::make_shared<MapSnapshot>();
  next->map = map_;
  next->name = pending_->name;
  next->epoch = epoch_;
  next->revision = pending_->revision;
  next->metric = pending_->metric;
  next->cameras = pending_->cameras;
  for (size_t index = 0; index < pending_->keyframe_versions.size(); ++index) {
    next->keyframe_blocks.push_back(staged_keyframes_.at(static_cast<uint32_t>(index)));
  }

  // Patch vectors depend on the source keyframe's pose. Any change of it, however small, makes the block
  // anew, so that the snapshot does not depend on which revisions this client happened to see (lockstep needs
  // that); it costs some 10 us a block.
  const std::set<KeyframeId> moved = moved_keyframes(next->keyframe_blocks);
  const bool same_epoch = snapshot_ != nullptr && snapshot_->epoch == epoch_;
  std::vector<PointParts> parts;
  for (size_t i = 0; i < pending_->points.size(); ++i) {
    parts.push_back(staged_points_.at(pending_->points[i].index));
    const bool source_moved =
        std::any_of(parts[i].patches->points.begin(), parts[i].patches->points.end(),
                    [&](const PointSource& point) { return moved.contains(point.keyframe); });
    const bool reuse =
        same_epoch && i < snapshot_parts_.size() && snapshot_parts_[i] == parts[i] && !source_moved;
    next->point_blocks.push_back(
        reuse ? snapshot_->point_blocks[i]
              : make_point_block(parts[i].patches, parts[i].positions, next->keyframe_blocks));
  }
  snapshot_ = std::move(next);
  snapshot_parts_ = std::move(parts);
  pending_.reset();
  overtaken_since_.reset();
}

}  // namespace cairn
