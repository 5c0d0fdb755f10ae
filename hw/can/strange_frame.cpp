// SPDX-License-Identifier: Apache-2.0
#include "hw/can/strange_frame.h"

#include "hw/can/codec_fault.h"
#include "hw/can/xsens.h"

namespace cairn {

std::string describe_strange(const CanFrame& frame, std::span<const odrive::Node> nodes) {
  const auto of_drive = odrive::decode(frame, nodes);
  const auto of_imu = xsens::decode(frame);
  if (of_drive || of_imu) return {};
  // The IMU's identifiers are those of no node that a drive may have.
  if (of_drive.error().kind == CodecFault::Kind::kUnknownNode &&
      of_imu.error().kind != CodecFault::Kind::kUnknownId)
    return describe(of_imu.error(), "the IMU");
  return describe(of_drive.error(), "the drives");
}

}  // namespace cairn
