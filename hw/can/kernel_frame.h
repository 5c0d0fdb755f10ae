// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <linux/can.h>

#include <cstddef>
#include <variant>

#include "hw/can/bus_errors.h"
#include "hw/can/frame.h"

namespace cairn {

/// A frame as the kernel's sockets take and give it: the first `size` bytes of `frame` are a can_frame
/// (CAN_MTU) or a canfd_frame (CANFD_MTU).
struct KernelFrame {
  canfd_frame frame{};
  size_t size = 0;
};

/// The kernel's form of a valid frame.
[[nodiscard]] KernelFrame to_kernel(const CanFrame& frame);
/// Reads the kernel's form: a frame, an error frame, or bytes that are neither.
[[nodiscard]] std::variant<std::monostate, CanFrame, BusErrors> from_kernel(const KernelFrame& kernel);
[[nodiscard]] can_filter to_kernel(const CanFilter& filter);

}  // namespace cairn
