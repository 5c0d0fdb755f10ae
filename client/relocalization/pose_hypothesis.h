// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

/// A hypothesis from the server: where a lost camera may be. It is believed when the next frames have
/// verified it.
struct PoseHypothesis {
  MapId map;
  Epoch epoch;
  KeyframeId reference;
  SE3 camera_from_reference;  ///< of the frame that was asked about
  bool confirmed = true;      ///< by geometry, and compared with all maps
};

/// What a tracker does with the answer to its query.
enum class PlaceUse {
  kToVerify,   ///< with the next frame that comes with the map
  kNotNeeded,  ///< it knows where it is, or has not been lost for long enough to leave its map
  kNotKnown,   ///< the answer has no candidate, or one that was rejected again and again
};

}  // namespace cairn
