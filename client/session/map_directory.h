// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "client/session/link_monitor.h"
#include "common/map/ids.h"

namespace cairn {

/// The maps that the server lists, for clients that want a certain one. Pure. Used from one thread.
class MapDirectory {
 public:
  void listed(MapId map, const std::string& name) {
    Entry& entry = maps_[map];
    if (entry.order == 0) entry.order = ++listings_;
    entry.name = name;
  }
  void removed(MapId map) { maps_.erase(map); }

  /// The map of a name if the server in sight has it: of several, the one whose first listing is the latest.
  [[nodiscard]] MapId find(const std::string& name, const LinkMonitor& monitor) const {
    MapId found;
    uint64_t latest = 0;
    for (const auto& [map, entry] : maps_) {
      if (entry.name != name || entry.order < latest || !monitor.knows(map)) continue;
      found = map;
      latest = entry.order;
    }
    return found;
  }

 private:
  struct Entry {
    std::string name;
    uint64_t order = 0;
  };
  uint64_t listings_ = 0;
  std::map<MapId, Entry> maps_;
};

}  // namespace cairn
