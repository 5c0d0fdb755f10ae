// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>

#include "client/session/session.h"
#include "common/map/ids.h"

namespace cairn {

/// What a client makes of the server's signs of life: which server it is, whether it is there, which maps it
/// has. Pure. Used from one thread.
class LinkMonitor {
 public:
  enum class Event : uint8_t {
    kNone,
    kConnected,  ///< the first server
    kGone,       ///< silent beyond its liveliness lease, crashed or left
    kReturned,   ///< the same server is back: go on where we were
    kRestarted,  ///< another server, or the same started anew: it knows nothing of us
  };

  /// A ServerStatus came. `start_count` is the least epoch that the maps of this server can have.
  Event heard(ServerId server, uint64_t start_count);
  /// Whether the writer of ServerStatus is alive, as the middleware sees it.
  Event alive(bool is_alive);

  void map_listed(MapId map, Epoch epoch);
  void map_removed(MapId map) { maps_.erase(map); }
  [[nodiscard]] bool knows(MapId map) const { return maps_.contains(map); }

  /// kConnecting, kConnected or kGone.
  [[nodiscard]] ServerLink link() const { return link_; }

 private:
  ServerLink link_ = ServerLink::kConnecting;
  ServerId server_;
  uint64_t start_count_ = 0;
  std::map<MapId, Epoch> maps_;
};

}  // namespace cairn
