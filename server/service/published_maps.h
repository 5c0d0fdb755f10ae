// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <vector>

#include "common/map/map_set.h"
#include "server/service/map_array.h"
#include "server/service/service_context.h"

namespace cairn {

/// The state that a reader of a map has at first; what comes then, ServiceOutput tells.
struct FollowedMap {
  MapSnapshotPtr newest;
  std::vector<wire::LabelMessage> labels;
};

/// The maps as readers have them: the newest revision of each, for whoever may read it. Used from the
/// service's thread, unless said otherwise.
class PublishedMaps {
 public:
  PublishedMaps(const ServiceContext& context, const MapArray& maps) : context_(context), maps_(maps) {}
  PublishedMaps(const PublishedMaps&) = delete;
  PublishedMaps& operator=(const PublishedMaps&) = delete;

  /// Sets the newest revision of its map.
  void show(const MapSnapshotPtr& snapshot);
  void remove(MapId map);

  /// The newest revision of each, by id. Thread-safe.
  [[nodiscard]] std::vector<MapSnapshotPtr> all() const;
  /// The newest revision and the labels of a map for somebody who begins to follow it; nothing where there is
  /// no such map for him (yet).
  [[nodiscard]] std::optional<FollowedMap> follow(const Principal& who, MapId map) const;
  /// The maps in which somebody may find himself.
  [[nodiscard]] MapSet readable_by(const Principal& who) const;

 private:
  const ServiceContext& context_;
  const MapArray& maps_;
  mutable std::mutex mutex_;  ///< of what follows
  std::map<MapId, MapSnapshotPtr> newest_;
};

}  // namespace cairn
