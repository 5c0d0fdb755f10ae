// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

/// Where a lost camera may be, from outside: to be tried, and believed only when the next frames prove it.
struct PoseSuggestion {
  MapId map;
  Epoch epoch;
  KeyframeId reference;
  SE3 camera_from_reference;  ///< of the frame that was asked about
};

}  // namespace cairn
