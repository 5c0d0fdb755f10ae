// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/wire/topic.h"

namespace cairn::wire {

/// A reader that a peer has made, or one that has gone (closed, or its peer's lease is over).
struct DiscoveredReader {
  uint64_t handle = 0;  ///< equal for coming and going
  std::string topic;
  std::vector<std::string> partitions;
  bool gone = false;
  uint64_t participant = 0;  ///< whose it is: DiscoveredParticipant::handle
};

/// Tells which readers other participants have: the server makes a client's writers when the client's readers
/// appear. Attach it to a Waiter like any reader. One thread.
class DiscoveredReaders : public ReaderBase {
 public:
  [[nodiscard]] static Result<DiscoveredReaders> create(const Participant& participant);

  /// What has changed since the last call, in order. Every reader comes once and goes once.
  [[nodiscard]] std::vector<DiscoveredReader> take();

 private:
  using ReaderBase::ReaderBase;
  std::map<uint64_t, DiscoveredReader> known_;
};

/// Topic name under which a message's readers are discovered.
template <typename Message>
[[nodiscard]] std::string_view topic_name();

}  // namespace cairn::wire
