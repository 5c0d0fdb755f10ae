// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/time.h"

namespace cairn {

/// Identifier of a frame: 11 bits, or 29 where extended. The two are different names for different frames.
struct CanId {
  uint32_t value = 0;
  bool extended = false;
  auto operator<=>(const CanId&) const = default;
};

constexpr size_t kMaxClassicPayload = 8;
constexpr size_t kMaxFdPayload = 64;

/// A frame of classic CAN or CAN FD. Bytes of `data` from `length` on are 0.
struct CanFrame {
  CanId id{};
  bool remote = false;     ///< asks the other side for its frame of that identifier (RTR); classic only
  bool fd = false;         ///< CAN FD
  bool fast_data = false;  ///< CAN FD: the payload at the second bit rate
  uint8_t length = 0;      ///< [bytes]; of a remote frame, what is asked for
  std::array<uint8_t, kMaxFdPayload> data{};
  auto operator<=>(const CanFrame&) const = default;

  [[nodiscard]] std::span<const uint8_t> payload() const {
    return std::span(data).first(remote ? 0 : length);
  }
};

/// A frame and when it came.
struct ReceivedFrame {
  CanFrame frame;
  Timestamp stamp;  ///< kernel's, since the Unix epoch; never runs back (StampClock)
};

/// Whether a bus can carry it: identifier within its bits, and a length that the kind of frame has.
[[nodiscard]] bool is_valid(const CanFrame& frame);

/// Passes the frames of its kind whose identifier equals `id` in the bits of `mask`.
struct CanFilter {
  CanId id{};
  uint32_t mask = 0;

  /// Passes all frames of that identifier, remote ones too.
  [[nodiscard]] static CanFilter only(CanId id);
};

[[nodiscard]] bool matches(const CanFilter& filter, const CanFrame& frame);
/// Whether any filter of the list passes it; an empty list passes all.
[[nodiscard]] bool passes(const std::vector<CanFilter>& filters, const CanFrame& frame);

/// The identifier as candump writes it: 241, 0CF029E2.
[[nodiscard]] std::string to_string(CanId id);
/// The frame as candump writes it: 241#0203, 241#R4, 245##1 and its bytes.
[[nodiscard]] std::string to_string(const CanFrame& frame);

}  // namespace cairn
