// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/axis_fault.h"

namespace cairn {

const char* describe(AxisFault fault) {
  switch (fault) {
    case AxisFault::kSilent:
      return "does not answer; check its supply, its plug, its node number and the bit rate";
    case AxisFault::kReset:
      return "its drive was reset; check its supply, then clear the fault and home it";
    case AxisFault::kStuck:
      return "does not follow; free it, then clear the fault";
    case AxisFault::kOverLimit:
      return "is beyond its limits; check `gear`, `home` and what turned it, then clear the fault";
    case AxisFault::kWatchdog:
      return "its drive had no setpoint in time; check the load of bus and host, then clear the fault";
    case AxisFault::kDriveError:
      return "its drive reports an error; look its bits up in the drive's manual, then clear the fault";
    case AxisFault::kHoming:
      return "did not find its homing switch; check the switch and the drive's settings, then clear the "
             "fault";
    case AxisFault::kNotActivated:
      return "its drive does not enter closed loop; calibrate the drive, then clear the fault";
  }
  return "";
}

}  // namespace cairn
