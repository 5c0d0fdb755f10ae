// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>

#include "client/session/session_types.h"
#include "common/map/ids.h"

namespace cairn {

/// What a client concludes from the server's signs of life: which server it is, whether it is there, which
/// maps it has. Pure. Used from one thread.
class LinkMonitor {
 public:
  enum class Event : uint8_t {
    kNone,
    kConnected,  ///< the first server
    kGone,       ///< silent beyond its liveliness lease, crashed or left
    kReturned,   ///< the same server is back, or was started anew with all that it had: go on where we were
    kRestarted,  ///< another server, or one that has kept nothing: it knows nothing of us
  };

  /// A ServerStatus came; `start_count` grows with every start of a server.
  Event heard(ServerId server, uint64_t start_count);
  /// The writer of ServerStatus is alive, or has gone, as the middleware sees it.
  Event alive(bool is_alive);

  /// May come before the first status of the server that lists it.
  void map_listed(MapId map, ServerId by) { maps_[map] = by; }
  void map_removed(MapId map) { maps_.erase(map); }
  [[nodiscard]] bool knows(MapId map) const {
    const auto listed = maps_.find(map);
    return listed != maps_.end() && listed->second == server_;
  }
  /// The one heard last; none before the first.
  [[nodiscard]] ServerId server() const { return server_; }

  /// kConnecting, kConnected or kGone.
  [[nodiscard]] ServerLink link() const { return link_; }

 private:
  ServerLink link_ = ServerLink::kConnecting;
  ServerId server_;
  uint64_t start_count_ = 0;
  std::map<MapId, ServerId> maps_;
};

}  // namespace cairn
