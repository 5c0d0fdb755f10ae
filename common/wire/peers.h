// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace cairn::wire {

/// Names a publication (one writer of one peer) as long as it lives.
struct PublicationHandle {
  uint64_t value = 0;
  auto operator<=>(const PublicationHandle&) const = default;
};

/// Names the participant of a peer, that is, a process: the same for all that it publishes, and through
/// interruptions of the network.
struct PeerId {
  std::array<uint8_t, 16> bytes{};
  auto operator<=>(const PeerId&) const = default;
};

}  // namespace cairn::wire
