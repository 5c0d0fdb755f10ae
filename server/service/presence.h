// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <string>

#include "common/base/time.h"
#include "common/map/ids.h"
#include "common/wire/peers.h"

namespace cairn {

/// Which process speaks for a name. It holds the name from its first TrackerState until it has been silent
/// for kSilence (trackers speak several times a second, also without frames) or its writer has gone. It is
/// the same process as before if its session is (a new match after an interruption) or its publication (a new
/// session after a server's restart). A second live process under the name is refused. Pure: the time is
/// handed in. Used from one thread.
class Presence {
 public:
  static constexpr std::chrono::seconds kSilence{3};

  enum class Standing : uint8_t {
    kHolder,
    kNewHolder,  ///< has just taken the name, or begun another session
    kIntruder,   ///< another live process holds it
  };
  /// A TrackerState of `session` came in from the partition of `name`.
  [[nodiscard]] Standing heard(const std::string& name, SessionId session,
                               wire::PublicationHandle publication, MonotonicTime now);
  /// No writer of the name is alive any more.
  void gone(const std::string& name) { holders_.erase(name); }
  /// Whether commands of `session` count.
  [[nodiscard]] bool holds(const std::string& name, SessionId session) const;
  /// Whether the process that holds the name was last heard by this publication: none but it can use that.
  [[nodiscard]] bool is_holder(const std::string& name, wire::PublicationHandle publication) const;
  /// Names that are held and not silent.
  [[nodiscard]] int live_count(MonotonicTime now) const;

 private:
  struct Holder {
    SessionId session;
    wire::PublicationHandle publication;
    MonotonicTime last_heard;
  };
  std::map<std::string, Holder> holders_;
};

}  // namespace cairn
