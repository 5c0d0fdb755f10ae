// SPDX-License-Identifier: Apache-2.0
#include "client/session/label_replica.h"

#include <algorithm>
#include <utility>

namespace cairn {

void LabelReplica::receive(wire::LabelMessage message) {
  const LabelId id = message.label.id;
  labels_.insert_or_assign(id, Entry{message.epoch, std::move(message.label), std::nullopt});
  changed_ = true;
}

void LabelReplica::removed(LabelId label) {
  changed_ = labels_.erase(label) > 0 || changed_;
}

void LabelReplica::orphaned(LabelId label, MonotonicTime now) {
  const auto found = labels_.find(label);
  if (found != labels_.end()) found->second.orphaned_at = now;
}

void LabelReplica::orphan_all(MonotonicTime now) {
  for (auto& [id, entry] : labels_) entry.orphaned_at = now;
  served_since_.reset();
}

void LabelReplica::update(MonotonicTime now, bool served) {
  if (!served) {
    served_since_.reset();
    return;
  }
  if (!served_since_) served_since_ = now;
  const auto is_gone = [&](const auto& entry) {
    const auto& orphaned_at = entry.second.orphaned_at;
    return orphaned_at && now - std::max(*orphaned_at, *served_since_) >= kOrphanGrace;
  };
  changed_ = std::erase_if(labels_, is_gone) > 0 || changed_;
}

const LabelListPtr& LabelReplica::list(Epoch epoch) {
  if (!std::exchange(changed_, false) && epoch == listed_epoch_) return list_;
  listed_epoch_ = epoch;
  std::vector<Label> labels;
  for (const auto& [id, entry] : labels_) {
    if (entry.epoch == epoch) labels.push_back(entry.label);
  }
  list_ = labels.empty() ? nullptr : std::make_shared<const std::vector<Label>>(std::move(labels));
  return list_;
}

}  // namespace cairn
