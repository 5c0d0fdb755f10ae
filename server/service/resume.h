// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "server/mapping/map_maker.h"
#include "server/store/map_file.h"

/// How clients go on after a restart of the server: what had been decided is answered again, not decided
/// again, and what they say of an epoch before is still understood. Pure.
namespace cairn {

/// What is known of a client from before.
struct ResumedClient {
  SessionId session;                       ///< of its newest decision
  std::vector<wire::OfferOutcome> offers;  ///< decided in that session, ascending by seq
  std::optional<wire::SeedVerdict> seed;   ///< accepted in that session, the newest
};

/// The decisions kept with a map, as it is served now.
struct KeptDecisions {
  MapId map;
  Epoch epoch;
  std::span<const DecisionRecord> decisions;
};
[[nodiscard]] std::map<std::string, ResumedClient> resume_clients(std::span<const KeptDecisions> maps);

/// Makes a frame that was tracked in an earlier epoch one of the present: what was given an id after the last
/// save of that epoch is not what has the id now, and is left out. False when the frame cannot be used:
/// unknown epoch, or its reference keyframe is such a one.
[[nodiscard]] bool carry_over(std::span<const EpochRecord> epochs, Epoch tracked_in, Epoch present,
                              KeyframeInput* frame);

}  // namespace cairn
