// SPDX-License-Identifier: Apache-2.0
#include "server/service/young_maps.h"

#include <iterator>
#include <utility>

namespace cairn {
namespace {

bool is_held(TrackingState state) {
  return state == TrackingState::kTracking || state == TrackingState::kPoor ||
         state == TrackingState::kRotation;
}

}  // namespace

void YoungMaps::made(MapId map, std::string maker, SessionId session) {
  Young young;
  young.maker = std::move(maker);
  young.session = session;
  maps_.insert_or_assign(map, std::move(young));
}

void YoungMaps::heard(const std::string& client, const Word& word, MonotonicTime now) {
  for (auto it = maps_.begin(); it != maps_.end();) {
    auto& [map, young] = *it;
    const bool is_here = word.map == map;
    bool may_die = true;
    if (client == young.maker) {
      may_die = word.session == young.session && note(&young, is_here, word, now);
    } else if (is_here) {
      may_die = !is_held(word.state);
      young.away_since.reset();  // it may be about to find itself there
    }
    it = may_die ? std::next(it) : maps_.erase(it);
  }
}

bool YoungMaps::note(Young* young, bool is_here, const Word& word, MonotonicTime now) {
  young->last_heard = now;
  const bool is_in = is_here && is_held(word.state);
  if (young->entered && !young->lost) {
    // Words get lost: up to the first that says otherwise it may have been tracked.
    young->tracked = word.frame_time - *young->entered;
    if (young->tracked > kYouth || young->tracked.count() < 0) return false;
    young->lost = !is_in;
  } else if (is_in) {
    if (young->lost) return false;  // seen again
    young->entered = word.frame_time;
  }
  if (is_here) {
    young->away_since.reset();
  } else if (!young->away_since) {
    young->away_since = now;
  }
  return true;
}

void YoungMaps::left(const std::string& client) {
  std::erase_if(maps_, [&](const auto& entry) { return entry.second.maker == client; });
}

std::vector<YoungMaps::Dead> YoungMaps::dead(MonotonicTime now, std::chrono::seconds wait) const {
  std::vector<Dead> maps;
  for (const auto& [map, young] : maps_) {
    if (young.away_since && now - *young.away_since >= wait && now - young.last_heard < kSilence)
      maps.push_back({map, young.maker, young.tracked});
  }
  return maps;
}

}  // namespace cairn
