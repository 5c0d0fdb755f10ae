// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "hw/can/frame.h"
#include "hw/can/odrive.h"

namespace cairn {

/// Why a frame is no message of a rig's drives and of its IMU, with what may help; empty: it is one.
[[nodiscard]] std::string describe_strange(const CanFrame& frame, std::span<const odrive::Node> nodes);

}  // namespace cairn
