// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/map/ids.h"

namespace cairn {

/// Who is sent how much of its map in one turn of the endpoint's thread. However many clients wait, a turn
/// writes only so much before samples are taken and verdicts written again. Those whose keyframes the map is
/// made of have a share of their own, so that they wait for no reader; within a share, clients take turns.
/// Used from one thread.
template <typename Feed>
class FeedTurns {
 public:
  /// Some eight blocks of patches, or all positions of a room: less than a millisecond, and 150 ms on a link
  /// of 20 Mbit/s.
  static constexpr size_t kBytesPerShare = 360'000;

  struct Waiting {
    std::string_view client;
    MapId map;
    bool is_author = false;
    Feed* feed = nullptr;

    [[nodiscard]] bool is_behind(const std::pair<std::string, MapId>& other) const {
      return std::pair(std::string_view(other.first), other.second) < std::pair(client, map);
    }
  };

  /// `waiting`: those that have something to write, by client and map. Feed::work(now, bytes) writes blocks
  /// until that many bytes are reached or nothing is left, and tells how many it wrote, at least one.
  void take_turn(const std::vector<Waiting>& waiting, MonotonicTime now) {
    serve(waiting, true, &last_author_, now);
    serve(waiting, false, &last_reader_, now);
  }

 private:
  using Key = std::pair<std::string, MapId>;

  /// Serves the feeds of authors, or those of others, until their share is written. Begins behind the feed
  /// that was served last, and goes around.
  void serve(const std::vector<Waiting>& waiting, bool authors, Key* last, MonotonicTime now) {
    const Key before = *last;
    size_t left = kBytesPerShare;
    for (const bool is_behind : {true, false}) {
      for (const Waiting& next : waiting) {
        if (left == 0) return;
        if (next.is_author != authors || is_behind != next.is_behind(before)) continue;
        left -= std::min(left, next.feed->work(now, left));
        *last = Key(next.client, next.map);
      }
    }
  }

  Key last_author_;
  Key last_reader_;
};

}  // namespace cairn
