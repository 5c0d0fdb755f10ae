// SPDX-License-Identifier: Apache-2.0
#include "hw/can/codec_fault.h"

namespace cairn {

std::string describe(const CodecFault& fault, std::string_view protocol) {
  const std::string frame = "frame " + to_string(fault.id) + ": ";
  const std::string name(protocol);
  switch (fault.kind) {
    case CodecFault::Kind::kUnknownNode:
      return frame + "of a node that the rig does not have; are its node numbers those of the configuration?";
    case CodecFault::Kind::kUnknownId:
      return frame + "no message of " + name + " that the rig knows; do two devices share an identifier?";
    case CodecFault::Kind::kWrongLength:
      return frame + std::to_string(fault.length) + " bytes, not the " + std::to_string(fault.expected) +
             " of this message of " + name + "; do device and firmware speak it?";
    case CodecFault::Kind::kWrongKind:
      return frame + "extended, CAN FD or remote, which " + name + " does not use for it";
    case CodecFault::Kind::kNotFinite:
      return frame + "a number that is not finite; is the device calibrated?";
  }
  return {};
}

}  // namespace cairn
