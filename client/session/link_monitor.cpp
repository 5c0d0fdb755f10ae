// SPDX-License-Identifier: Apache-2.0
#include "client/session/link_monitor.h"

#include <utility>

namespace cairn {

LinkMonitor::Event LinkMonitor::heard(ServerId server, uint64_t start_count) {
  const ServerLink before = std::exchange(link_, ServerLink::kConnected);
  if (server != server_) {
    const bool first = !server_;
    server_ = server;
    start_count_ = start_count;
    // MapInfo may come before or after the status; the epochs tell which server a map was listed by.
    std::erase_if(maps_, [start_count](const auto& entry) { return entry.second.value < start_count; });
    return first ? Event::kConnected : Event::kRestarted;
  }
  return before == ServerLink::kGone ? Event::kReturned : Event::kNone;
}

LinkMonitor::Event LinkMonitor::alive(bool is_alive) {
  if (is_alive || link_ != ServerLink::kConnected) return Event::kNone;
  link_ = ServerLink::kGone;
  return Event::kGone;
}

void LinkMonitor::map_listed(MapId map, Epoch epoch) {
  if (epoch.value >= start_count_) maps_[map] = epoch;
}

}  // namespace cairn
