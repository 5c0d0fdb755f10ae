// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/wire/peers.h"
#include "common/wire/topic.h"

namespace cairn::wire {

/// A reader that a peer has made, or one that has gone (closed, or its peer's lease is over).
struct DiscoveredReader {
  uint64_t handle = 0;  ///< equal for coming and going
  std::string topic;
  std::vector<std::string> partitions;
  bool gone = false;
  uint64_t participant = 0;  ///< whose it is: DiscoveredParticipant::handle
  PeerId process{};          ///< likewise, as of its publications
};

/// A peer that has announced itself, or one that has gone. In a secured site the middleware has not asked it
/// for its keys yet, or in vain.
struct DiscoveredParticipant {
  uint64_t handle = 0;  ///< equal for coming and going
  std::string says;     ///< what it says of itself, be that true or not: "process ddsperf, host desk-3"
  bool gone = false;
};

/// Tells which of these other participants have, or are. Attach it to a Waiter like any reader. One thread.
template <typename Peer>
class Discovered : public ReaderBase {
 public:
  [[nodiscard]] static Result<Discovered> create(const Participant& participant);

  /// What has changed since the last call, in order. Each comes once and goes once.
  [[nodiscard]] std::vector<Peer> take();

 private:
  using ReaderBase::ReaderBase;
  std::map<uint64_t, Peer> known_;
};
/// The server makes a client's writers when the client's readers appear.
using DiscoveredReaders = Discovered<DiscoveredReader>;
using DiscoveredParticipants = Discovered<DiscoveredParticipant>;

/// Topic name under which a message's readers are discovered.
template <typename Message>
[[nodiscard]] std::string_view topic_name();

}  // namespace cairn::wire
