// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/keyframe_policy.h"

#include <algorithm>

namespace cairn {

bool KeyframePolicy::wants(int found, double distance, bool widens_map,
                           const std::function<bool()>& is_new_area) {
  if (found > most_found_) forget_found(found);  // the map grew, or the camera came back to it
  if (!is_due(found, distance, widens_map, is_new_area)) return false;
  since_ = 0;
  forget_found(found);
  return true;
}

void KeyframePolicy::forget_found(int found) {
  most_found_ = found;
  found_in_known_area_.reset();
}

bool KeyframePolicy::is_due(int found, double distance, bool widens_map,
                            const std::function<bool()>& is_new_area) {
  // Far beyond the distance the wait between offers shortens.
  const auto has_waited = [&](double wait) { return since_ >= wait * options_.frames_between; };
  if (widens_map && has_waited(options_.shortest_wait)) return true;
  if (distance >= options_.distance &&
      has_waited(std::max(options_.shortest_wait, options_.distance / distance)))
    return true;
  // A view of which the map knows less and less needs a keyframe sooner: what is new in it must become points
  // while the camera can still be placed by the old ones.
  if (distance < options_.distance * options_.need_distance || !has_waited(options_.shortest_wait))
    return false;
  const auto at_best = static_cast<float>(most_found_);
  if (found < options_.scarce_points || static_cast<float>(found) < options_.few_left * at_best) return true;
  return static_cast<float>(found) < options_.running_out * at_best && shows_new_area(found, is_new_area);
}

bool KeyframePolicy::shows_new_area(int found, const std::function<bool()>& is_new_area) {
  if (found_in_known_area_ && found >= *found_in_known_area_) return false;
  if (is_new_area()) return true;
  found_in_known_area_ = found;
  return false;
}

}  // namespace cairn
