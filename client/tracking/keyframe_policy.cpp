// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/keyframe_policy.h"

#include <algorithm>

namespace cairn {

bool KeyframePolicy::wants(int found, double distance) {
  // A view of which the map knows less and less needs a keyframe sooner: what is new in it must become points
  // while the camera can still be placed by the old ones.
  most_found_ = std::max(most_found_, found);
  const bool in_need = found < options_.scarce_points ||
                       static_cast<float>(found) < options_.running_out * static_cast<float>(most_found_);
  if (distance < options_.keyframe_distance * (in_need ? options_.need_distance : 1.0)) return false;
  // Far beyond the limit the wait between offers shortens: a camera that moves fast would run out of its map.
  constexpr double kShortestWait = 0.1;
  const double wait =
      in_need ? kShortestWait : std::max(kShortestWait, options_.keyframe_distance / distance);
  if (since_ < wait * options_.frames_between_keyframes) return false;
  since_ = 0;
  most_found_ = found;
  return true;
}

}  // namespace cairn
