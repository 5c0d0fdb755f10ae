// SPDX-License-Identifier: Apache-2.0
#include "client/session/map_choice.h"

#include <algorithm>
#include <utility>

namespace cairn {

bool MapChoice::is_recent(MapId map) const {
  return std::ranges::find(recent_, map) != recent_.end();
}

bool MapChoice::choose(MapId map) {
  if (in_use_ == map) return false;
  in_use_ = map;
  required_.reset();
  if (!map) {
    snapshot_ = nullptr;
    return true;
  }
  std::erase(recent_, map);
  recent_.push_front(map);
  if (recent_.size() > recent_limit_) {
    replicas_.erase(recent_.back());
    labels_.erase(recent_.back());
    recent_.pop_back();
  }
  if (const MapSnapshotPtr replica = replica_in_use()) snapshot_ = replica;
  return true;
}

bool MapChoice::swap_in(const MapSnapshotPtr& revision) {
  replicas_[revision->map] = revision;
  if (revision->map != in_use_) return false;
  snapshot_ = revision;
  return true;
}

MapSnapshotPtr MapChoice::replica_in_use() const {
  const auto replica = replicas_.find(in_use_);
  return replica == replicas_.end() ? nullptr : replica->second;
}

void MapChoice::set_labels(MapId map, LabelListPtr labels) {
  if (is_recent(map)) labels_[map] = std::move(labels);
}

LabelListPtr MapChoice::labels(MapId map) const {
  const auto labels = labels_.find(map);
  return labels == labels_.end() ? nullptr : labels->second;
}

void MapChoice::require(const RequiredRevision& wanted) {
  if (wanted.map != in_use_) return;
  const bool is_later = !required_ || required_->map != wanted.map || required_->epoch < wanted.epoch ||
                        (required_->epoch == wanted.epoch && required_->revision < wanted.revision);
  if (is_later) required_ = wanted;
}

bool MapChoice::is_current() const {
  if (!required_ || required_->map != in_use_) return true;
  const MapSnapshotPtr replica = replica_in_use();
  if (replica == nullptr || replica->epoch != required_->epoch)
    return replica && replica->epoch > required_->epoch;
  return replica->revision >= required_->revision;
}

}  // namespace cairn
