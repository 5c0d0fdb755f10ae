// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_publisher.h"

#include <utility>

namespace cairn {
namespace {

KeyframeId last_keyframe(const MapSnapshot& map) {
  if (map.keyframe_blocks.empty() || map.keyframe_blocks.back()->keyframes.empty()) return {};
  return map.keyframe_blocks.back()->keyframes.back().id;
}

PointId last_point(const MapSnapshot& map) {
  if (map.point_blocks.empty() || map.point_blocks.back()->patches->points.empty()) return {};
  return map.point_blocks.back()->patches->points.back().id;
}

/// Whether `next` brings something to see, not only better numbers.
bool has_grown(const MapSnapshot& before, const MapSnapshot& next) {
  return before.epoch != next.epoch || last_keyframe(before) != last_keyframe(next) ||
         last_point(before) != last_point(next);
}

}  // namespace

void MapPublisher::client_has(Epoch epoch, Revision revision) {
  client_epoch_ = epoch;
  client_revision_ = revision;
}

bool MapPublisher::is_up_to_date() const {
  return newest_ == nullptr ||
         (sent_ != nullptr && sent_->epoch == newest_->epoch && sent_->revision == newest_->revision);
}

bool MapPublisher::has_caught_up() const {
  return client_epoch_ == sent_->epoch && client_revision_ >= sent_->revision;
}

std::optional<MonotonicTime> MapPublisher::deadline() const {
  if (is_up_to_date()) return std::nullopt;
  if (sent_ == nullptr) return retry_at_;
  if (!has_caught_up()) return sent_at_ + kCatchUpLimit;
  return has_grown(*sent_, *newest_) ? MonotonicTime::min() : sent_at_ + kAdjustmentInterval;
}

std::optional<Burst> MapPublisher::next(MonotonicTime now) {
  const auto due = deadline();
  if (!due || now < *due) return std::nullopt;
  Burst burst = make_burst();
  sent_ = newest_;
  sent_at_ = now;
  return burst;
}

void MapPublisher::failed(MonotonicTime now) {
  sent_ = nullptr;
  sent_points_.clear();
  sent_keyframes_.clear();
  retry_at_ = now + kRetryInterval;
}

Burst MapPublisher::make_burst() {
  if (sent_ != nullptr && sent_->epoch != newest_->epoch) {
    sent_points_.clear();
    sent_keyframes_.clear();
  }
  Burst burst;
  burst.map = newest_->map;
  burst.epoch = newest_->epoch;
  burst.commit = {newest_->map, newest_->name,   newest_->epoch, newest_->revision, newest_->metric, {},
                  {},           newest_->cameras};
  for (const auto& block : newest_->keyframe_blocks) {
    burst.commit.keyframe_versions.push_back(block->version);
    if (std::exchange(sent_keyframes_[block->index], block->version) != block->version) {
      burst.keyframes.push_back(block);
    }
  }
  for (const auto& block : newest_->point_blocks) {
    const uint32_t index = block->patches->index;
    const BlockVersions versions{block->patches->version, block->positions->version};
    burst.commit.points.push_back({index, versions.patches, versions.positions});
    const BlockVersions before = std::exchange(sent_points_[index], versions);
    if (before.patches != versions.patches) burst.patches.push_back(block->patches);
    if (before.positions != versions.positions) burst.positions.push_back(block->positions);
  }
  return burst;
}

}  // namespace cairn
