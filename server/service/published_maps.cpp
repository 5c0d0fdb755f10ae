// SPDX-License-Identifier: Apache-2.0
#include "server/service/published_maps.h"

#include <utility>

namespace cairn {

void PublishedMaps::show(const MapSnapshotPtr& snapshot) {
  const std::scoped_lock lock(mutex_);
  newest_[snapshot->map] = snapshot;
}

void PublishedMaps::remove(MapId map) {
  const std::scoped_lock lock(mutex_);
  newest_.erase(map);
}

std::vector<MapSnapshotPtr> PublishedMaps::all() const {
  const std::scoped_lock lock(mutex_);
  std::vector<MapSnapshotPtr> snapshots;
  for (const auto& [map, snapshot] : newest_) snapshots.push_back(snapshot);
  return snapshots;
}

std::optional<FollowedMap> PublishedMaps::follow(const Principal& who, MapId map) const {
  const auto found = maps_.all().find(map);
  if (found == maps_.all().end() || found->second.snapshot == nullptr) return std::nullopt;
  if (!context_.access().may_read(who, map)) return std::nullopt;
  FollowedMap followed{found->second.snapshot, {}};
  for (Label& label : found->second.labels.all())
    followed.labels.push_back({map, followed.newest->epoch, std::move(label)});
  return followed;
}

MapSet PublishedMaps::readable_by(const Principal& who) const {
  std::vector<MapId> served;
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) served.push_back(map);
  }
  return context_.access().readable(who, served);
}

}  // namespace cairn
