// SPDX-License-Identifier: Apache-2.0
#include "server/service/wearer_rule.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

/// The best that was found among some of the maps.
struct Best {
  int inliers = 0;
  bool confirmed = false;

  void take(const PlaceCandidate& candidate) {
    inliers = std::max(inliers, candidate.inliers);
    confirmed = confirmed || candidate.confirmed;
  }
};

bool is_one_of(const std::vector<MapId>& maps, const MapId& map) {
  return std::binary_search(maps.begin(), maps.end(), map);
}

/// Without confirmed places, `found` does not say that the place is not known: not all maps count.
RelocalizationAnswer left_open(RelocalizationAnswer found) {
  found.verdict = RelocalizationVerdict::kNotThere;
  found.reason = "not in the map in which the wearer's other camera is tracked";
  return found;
}

}  // namespace

void WearerRule::heard(const std::string& client, const Word& word, MonotonicTime now) {
  std::string wearer = word.wearer;
  if (options_.registered) {
    const auto known = options_.registered->find(client);
    wearer = known == options_.registered->end() ? std::string() : known->second;
  }
  Camera& camera = cameras_[client];
  const bool is_new_frame = word.frame_time != camera.frame_time;
  camera.wearer = std::move(wearer);
  camera.frame_time = word.frame_time;
  if (!word.verified_in || !is_new_frame) return;
  camera.verified_in = word.verified_in;
  camera.verified_at = now;
  camera.missed = 0;  // what was not found before it was found does not count in its next loss
}

std::string WearerRule::wearer_of(const std::string& client) const {
  const auto camera = cameras_.find(client);
  return camera == cameras_.end() ? std::string() : camera->second.wearer;
}

std::vector<MapId> WearerRule::maps_of_others(const std::string& client, const MapSet& findable,
                                              MonotonicTime now) const {
  std::vector<MapId> maps;
  const std::string wearer = wearer_of(client);
  if (wearer.empty()) return maps;
  for (const auto& [name, camera] : cameras_) {
    const bool is_fresh = camera.verified_in && now - camera.verified_at <= kFresh;
    if (name != client && camera.wearer == wearer && is_fresh) maps.push_back(camera.verified_in);
  }
  std::sort(maps.begin(), maps.end());
  maps.erase(std::unique(maps.begin(), maps.end()), maps.end());
  return findable.among(maps);
}

WearerRule::Search WearerRule::search(const std::string& client, const MapSet& findable,
                                      MonotonicTime now) const {
  std::vector<MapId> maps = maps_of_others(client, findable, now);
  if (!maps.empty() && options_.policy == WearerPolicy::kOnly) return {{MapSet(std::move(maps)), {}}, true};
  return {{findable, std::move(maps)}, false};
}

int WearerRule::count_miss(const std::string& client, const std::vector<MapId>& maps, bool confirmed) {
  Camera& camera = cameras_[client];
  if (confirmed || maps != camera.missed_in) camera.missed = 0;
  camera.missed_in = maps;
  if (!confirmed) camera.missed = std::min(camera.missed + 1, kQueries);
  return camera.missed;
}

RelocalizationAnswer WearerRule::narrow(const std::string& client, const MapSet& findable, bool in_part,
                                        RelocalizationAnswer found, MonotonicTime now) {
  const std::vector<MapId> maps = maps_of_others(client, findable, now);
  if (maps.empty()) {
    const bool is_open = in_part && found.verdict == RelocalizationVerdict::kNotKnown;
    return is_open ? left_open(std::move(found)) : found;
  }
  // A guess names the one keyframe that is nearest in all that was searched: there is nothing to weigh.
  if (found.verdict == RelocalizationVerdict::kUnconfirmed) return found;
  Best here;
  Best elsewhere;
  for (const PlaceCandidate& candidate : found.candidates)
    (is_one_of(maps, candidate.map) ? here : elsewhere).take(candidate);
  const int missed = count_miss(client, maps, here.confirmed);
  if (options_.policy == WearerPolicy::kFirst) {
    const bool is_clear = elsewhere.confirmed && elsewhere.inliers > kClearlyMore * here.inliers;
    if (missed >= kQueries || is_clear) return found;
    if (!here.confirmed && !elsewhere.confirmed) return found;  // all maps were searched: not known
  }
  std::erase_if(found.candidates, [&maps](const PlaceCandidate& c) { return !is_one_of(maps, c.map); });
  return here.confirmed ? found : left_open(std::move(found));
}

}  // namespace cairn
