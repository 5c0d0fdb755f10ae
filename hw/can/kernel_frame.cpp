// SPDX-License-Identifier: Apache-2.0
#include "hw/can/kernel_frame.h"

#include <algorithm>

namespace cairn {
namespace {

// The two have identifier, length and payload at the same places, as linux/can.h promises.
static_assert(offsetof(can_frame, can_id) == offsetof(canfd_frame, can_id));
static_assert(offsetof(can_frame, len) == offsetof(canfd_frame, len));
static_assert(offsetof(can_frame, data) == offsetof(canfd_frame, data));

uint32_t to_kernel(CanId id) {
  return id.value | (id.extended ? CAN_EFF_FLAG : 0);
}

CanId from_kernel(uint32_t id) {
  const bool extended = (id & CAN_EFF_FLAG) != 0;
  return {id & (extended ? CAN_EFF_MASK : CAN_SFF_MASK), extended};
}

}  // namespace

KernelFrame to_kernel(const CanFrame& frame) {
  KernelFrame kernel;
  kernel.size = frame.fd ? CANFD_MTU : CAN_MTU;
  kernel.frame.can_id = to_kernel(frame.id) | (frame.remote ? CAN_RTR_FLAG : 0);
  kernel.frame.len = frame.length;
  kernel.frame.flags = frame.fast_data ? CANFD_BRS : 0;
  std::ranges::copy(frame.payload(), std::begin(kernel.frame.data));
  return kernel;
}

std::variant<std::monostate, CanFrame, BusErrors> from_kernel(const KernelFrame& kernel) {
  const canfd_frame& raw = kernel.frame;
  if (kernel.size != CAN_MTU && kernel.size != CANFD_MTU) return std::monostate();
  CanFrame frame;
  frame.fd = kernel.size == CANFD_MTU;
  if ((raw.can_id & CAN_ERR_FLAG) != 0) {
    std::array<uint8_t, kMaxClassicPayload> data{};
    std::copy_n(std::begin(raw.data), data.size(), data.begin());
    return decode_error_frame(raw.can_id & CAN_ERR_MASK, data);
  }
  frame.id = from_kernel(raw.can_id);
  frame.remote = (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.fast_data = frame.fd && (raw.flags & CANFD_BRS) != 0;
  frame.length = raw.len;
  if (!is_valid(frame)) return std::monostate();
  std::copy_n(std::begin(raw.data), frame.payload().size(), frame.data.begin());
  return frame;
}

can_filter to_kernel(const CanFilter& filter) {
  // The flag in the mask keeps 11 and 29 bits apart.
  return {to_kernel(filter.id), filter.mask | CAN_EFF_FLAG};
}

}  // namespace cairn
