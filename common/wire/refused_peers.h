// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

namespace cairn::wire {

/// Somebody who wanted to take part in a secured site, and whom the middleware did not let in.
struct RefusedPeer {
  std::string
      who;  ///< "somebody as client phone-1": so its certificate says, be that true or not; or "somebody"
  std::string why;  ///< for a person
  auto operator<=>(const RefusedPeer&) const = default;
};

/// What a line of the middleware's log says of such a one; nothing: it is about something else. The API has
/// no other word of it.
[[nodiscard]] std::optional<RefusedPeer> refused_peer_in(std::string_view line);

/// Those since they were taken last, each once, and not more than a few: who tries must not fill anything.
/// Thread-safe.
class RefusedPeers {
 public:
  static constexpr size_t kMost = 32;

  /// Whether the line says that somebody was not let in.
  bool note(std::string_view line);
  [[nodiscard]] std::vector<RefusedPeer> take();

 private:
  std::mutex mutex_;
  std::set<RefusedPeer> peers_;
};

}  // namespace cairn::wire
