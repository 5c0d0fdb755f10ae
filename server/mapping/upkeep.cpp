// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/upkeep.h"

namespace cairn {
namespace {

constexpr size_t kFirstKept =
    2;  ///< by definition: problems hold the first, its tracker begins at the second

/// Whether a map without this keyframe still holds the measured point as well as with it: its patch is from
/// elsewhere, and at least `observers` others that do not add only show it at the same or a finer level.
bool is_dispensable(const MapState& map, KeyframeId keyframe, const Measurement& m, int observers) {
  const MapPoint& point = map.point(m.point);
  if (point.source->keyframe == keyframe) return false;
  int others = 0;
  for (const KeyframeId observer : point.observers) {
    if (observer == keyframe || map.keyframe(observer).adds_only) continue;
    if (map.find_measurement(observer, m.point)->level <= m.level) ++others;
  }
  return others >= observers;
}

bool is_redundant(const MapState& map, const MapKeyframe& keyframe, const UpkeepOptions& options) {
  const auto measured = static_cast<double>(keyframe.measurements.size());
  int needed = 0;
  for (const Measurement& m : keyframe.measurements) {
    needed += is_dispensable(map, keyframe.id, m, options.redundant_observers) ? 0 : 1;
    if (needed > (1 - options.redundant_fraction) * measured) return false;
  }
  return true;
}

}  // namespace

int cull_points(MapState* map, const UpkeepOptions& options) {
  int culled = 0;
  for (const MapPoint& p : map->points()) {
    // Nothing but a tracker's word speaks for a point of one view: the first that should show it decides.
    const int enough = p.observers.size() < 2 ? 1 : options.min_attempts;
    if (!p.live || p.attempts < enough || p.found >= options.min_found_fraction * p.attempts) continue;
    map->remove_point(p.id);
    ++culled;
  }
  return culled;
}

std::optional<KeyframeId> find_redundant_keyframe(const MapState& map, KeyframeId newest,
                                                  const UpkeepOptions& options) {
  const std::vector<MapKeyframe>& all = map.keyframes();
  const std::vector<int> shared = map.shared_points(map.keyframe(newest).measurements);
  for (size_t i = kFirstKept; i + options.newest_kept < all.size(); ++i) {
    if (all[i].live && shared[i] > 0 && is_redundant(map, all[i], options)) return all[i].id;
  }
  return std::nullopt;
}

}  // namespace cairn
