// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace cairn {

/// Why an axis may not move until the fault is cleared.
enum class AxisFault : uint8_t {
  kSilent,        ///< the drive does not answer
  kReset,         ///< the drive was reset, or let go by itself: its position is in doubt
  kStuck,         ///< the axis does not follow its setpoints
  kOverLimit,     ///< beyond a hard limit of position, or far above that of rate
  kWatchdog,      ///< the drive had no setpoints for too long
  kDriveError,    ///< the drive names another error
  kHoming,        ///< homing did not end at the switch
  kNotActivated,  ///< the drive did not enter closed loop
};

/// Says what the fault is and what helps, "does not answer; check ...", to follow the name of the axis.
[[nodiscard]] const char* describe(AxisFault fault);

}  // namespace cairn
