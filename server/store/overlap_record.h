// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "common/base/time.h"
#include "common/map/ids.h"

namespace cairn {

/// Two maps that show the same place. `one` < `other`.
struct OverlapRecord {
  MapId one;
  MapId other;
  uint32_t of_one = 0;  ///< keyframes of the one that show the other, the most there have been
  uint32_t of_other = 0;
  Timestamp found;  ///< when it was first known

  friend bool operator==(const OverlapRecord&, const OverlapRecord&) = default;
};

}  // namespace cairn
