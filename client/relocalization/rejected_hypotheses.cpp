// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/rejected_hypotheses.h"

#include <algorithm>
#include <cmath>

namespace cairn {
void RejectedHypotheses::reject(const PoseHypothesis& place, Timestamp time) {
  std::erase_if(places_, [&](const Place& p) {
    return std::abs(seconds_between(p.latest, time)) > options_.remembered;  // recordings may jump back
  });
  auto known = std::find_if(places_.begin(), places_.end(), [&](const Place& p) {
    return p.map == place.map && p.epoch == place.epoch && p.reference == place.reference;
  });
  if (known == places_.end())
    known = places_.insert(places_.end(), {place.map, place.epoch, place.reference, 0, time});
  ++known->times;
  known->latest = time;
}

bool RejectedHypotheses::is_rejected(const PoseHypothesis& place, Timestamp time) const {
  return std::any_of(places_.begin(), places_.end(), [&](const Place& p) {
    return p.map == place.map && p.epoch == place.epoch && p.reference == place.reference &&
           p.times >= options_.enough && std::abs(seconds_between(p.latest, time)) <= options_.remembered;
  });
}

}  // namespace cairn
