// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/upkeep.h"

namespace cairn {
namespace {

constexpr int kMinAttempts = 6;  ///< before a point is judged
constexpr double kMinFoundFraction = 0.2;
constexpr int kRedundantObservers = 3;
constexpr double kRedundantFraction = 0.9;
constexpr size_t kFirstKept = 2;   ///< problems hold the first, its tracker begins at the second
constexpr size_t kNewestKept = 5;  ///< still being integrated, or the reference of offers in flight

/// Whether a map without this keyframe still holds the measured point as well as with it.
bool is_dispensable(const MapState& map, KeyframeId keyframe, const Measurement& m) {
  const MapPoint& point = map.point(m.point);
  if (point.source->keyframe == keyframe) return false;
  int others = 0;
  for (const KeyframeId observer : point.observers) {
    if (observer != keyframe && map.find_measurement(observer, m.point)->level <= m.level) ++others;
  }
  return others >= kRedundantObservers;
}

bool is_redundant(const MapState& map, const MapKeyframe& keyframe) {
  const auto measured = static_cast<double>(keyframe.measurements.size());
  int needed = 0;
  for (const Measurement& m : keyframe.measurements) {
    needed += is_dispensable(map, keyframe.id, m) ? 0 : 1;
    if (needed > (1 - kRedundantFraction) * measured) return false;
  }
  return true;
}

}  // namespace

int cull_points(MapState* map) {
  int culled = 0;
  for (const MapPoint& p : map->points()) {
    // Nothing but a tracker's word speaks for a point of one view: the first that should show it decides.
    const int enough = p.observers.size() < 2 ? 1 : kMinAttempts;
    if (!p.live || p.attempts < enough || p.found >= kMinFoundFraction * p.attempts) continue;
    map->remove_point(p.id);
    ++culled;
  }
  return culled;
}

std::optional<KeyframeId> find_redundant_keyframe(const MapState& map, KeyframeId newest) {
  const std::vector<MapKeyframe>& all = map.keyframes();
  const std::vector<int> shared = map.shared_points(map.keyframe(newest).measurements);
  for (size_t i = kFirstKept; i + kNewestKept < all.size(); ++i) {
    if (all[i].live && shared[i] > 0 && is_redundant(map, all[i])) return all[i].id;
  }
  return std::nullopt;
}

}  // namespace cairn
