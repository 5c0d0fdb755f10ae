// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/wire/topic.h"

namespace cairn::wire {

/// A peer that has announced itself, or one that has gone. In a secured site the middleware has not asked it
/// for its keys yet, or in vain.
struct DiscoveredParticipant {
  uint64_t handle = 0;  ///< DiscoveredReader::participant
  std::string says;     ///< what it says of itself, be that true or not: "process ddsperf, host desk-3"
  bool gone = false;
};

/// Tells which other participants there are. Attach it to a Waiter like any reader. One thread.
class DiscoveredParticipants : public ReaderBase {
 public:
  [[nodiscard]] static Result<DiscoveredParticipants> create(const Participant& participant);

  /// What has changed since the last call, in order. Every participant comes once and goes once.
  [[nodiscard]] std::vector<DiscoveredParticipant> take();

 private:
  using ReaderBase::ReaderBase;
  std::map<uint64_t, DiscoveredParticipant> known_;
};

}  // namespace cairn::wire
