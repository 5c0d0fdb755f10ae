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

/// The refused peer that a line of the middleware's log tells of; nothing: the line is about something else.
/// The API has no other word of refusals.
[[nodiscard]] std::optional<RefusedPeer> refused_peer_in(std::string_view line);

/// Collects the peers that were refused since they were taken last, each once, and not more than a few:
/// whoever tries again and again must not fill anything. Thread-safe.
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
