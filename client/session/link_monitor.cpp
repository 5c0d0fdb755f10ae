// SPDX-License-Identifier: Apache-2.0
#include "client/session/link_monitor.h"

#include <utility>

namespace cairn {

LinkMonitor::Event LinkMonitor::heard(ServerId server, uint64_t start_count) {
  const ServerLink before = std::exchange(link_, ServerLink::kConnected);
  const bool same_start = std::exchange(start_count_, start_count) == start_count;
  if (server != server_) {
    const bool first = !server_;
    server_ = server;
    std::erase_if(maps_, [server](const auto& entry) { return entry.second != server; });
    return first ? Event::kConnected : Event::kRestarted;
  }
  // A quick restart is over before its silence has been noticed.
  return before == ServerLink::kGone || !same_start ? Event::kReturned : Event::kNone;
}

LinkMonitor::Event LinkMonitor::alive(bool is_alive) {
  if (is_alive || link_ != ServerLink::kConnected) return Event::kNone;
  link_ = ServerLink::kGone;
  return Event::kGone;
}

}  // namespace cairn
