// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/map/ids.h"
#include "common/map/observations.h"

namespace cairn {

/// Maps that their makers have just begun. One that its maker loses within a second of tracking, and in which
/// nobody has been since, is dead: it is in everybody's way, and nobody's place. It may go once its maker has
/// been elsewhere for a while. Whatever shows that a map is of use takes it off this list for good, and so
/// does whatever leaves that in doubt: a maker that goes, an earlier run of the server. Pure: words and times
/// are handed in. Used from one thread.
class YoungMaps {
 public:
  /// Time for which its maker may track a map until it is young no longer.
  static constexpr std::chrono::seconds kYouth{1};
  /// Nothing is concluded from the silence of a maker: trackers speak several times a second.
  static constexpr std::chrono::seconds kSilence{3};

  /// What a tracker says of its state.
  struct Word {
    SessionId session;
    TrackingState state = TrackingState::kStarting;
    MapId map;  ///< in use; none: it starts anew
    Timestamp frame_time;
  };
  struct Dead {
    MapId map;
    std::string maker;
    std::chrono::nanoseconds tracked;  ///< by its maker, as it said
  };

  void made(MapId map, std::string maker, SessionId session);
  void heard(const std::string& client, const Word& word, MonotonicTime now);
  /// Notes that a client has gone: the maps that it made are not dropped any more.
  void left(const std::string& client);
  /// Forgets a map that is of use or is no more: somebody has been found in it, it has grown, been named,
  /// labelled.
  void forget(MapId map) { maps_.erase(map); }
  /// Maps whose makers have been elsewhere for `wait`, and still are.
  [[nodiscard]] std::vector<Dead> dead(MonotonicTime now, std::chrono::seconds wait) const;

 private:
  struct Young {
    std::string maker;
    SessionId session;
    std::optional<Timestamp> entered;  ///< the first frame that was held in it
    std::chrono::nanoseconds tracked{0};
    bool lost = false;
    std::optional<MonotonicTime> away_since;  ///< its maker, and whoever looks whether it is there
    MonotonicTime last_heard;
  };
  /// Notes what the maker of a map says. Returns whether the map may still be dropped.
  [[nodiscard]] static bool note(Young* young, bool is_here, const Word& word, MonotonicTime now);

  std::map<MapId, Young> maps_;
};

}  // namespace cairn
