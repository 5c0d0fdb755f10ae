// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "common/base/result.h"
#include "hw/can/frame.h"

namespace cairn {

/// Why a frame is no message, for who counts them or reacts to one kind; describe() for people. It costs no
/// memory, since a foreign node may send thousands of them a second.
struct CodecFault {
  enum class Kind : uint8_t {
    kUnknownNode,  ///< from or to a node that is not of the rig
    kUnknownId,    ///< no message has this identifier
    kWrongLength,  ///< `length` bytes, where the message has `expected`
    kWrongKind,    ///< extended, CAN FD or remote, which the protocol has not here
    kNotFinite,    ///< an infinite number or none
  };
  Kind kind = Kind::kUnknownId;
  CanId id;
  uint8_t length = 0;
  uint8_t expected = 0;
  bool operator==(const CodecFault&) const = default;
};

template <typename T>
using Decoded = tl::expected<T, CodecFault>;

/// "frame 201: 7 bytes, not the 8 of an ODrive message; is the firmware 0.6?" for a protocol so named.
[[nodiscard]] std::string describe(const CodecFault& fault, std::string_view protocol);

}  // namespace cairn
