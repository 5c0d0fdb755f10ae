// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/wire/messages.h"
#include "server/mapping/map_maker.h"
#include "server/store/map_file.h"

/// How clients go on after a restart of the server: what had been decided is answered again, not decided
/// again, and what they say of an epoch before is still understood. Pure.
namespace cairn {

/// What is known of a client from before.
struct ResumedClient {
  SessionId session;                           ///< of its newest decision
  std::vector<wire::OfferOutcome> offers;      ///< decided in that session, ascending by seq
  std::optional<wire::SeedVerdict> seed;       ///< accepted in that session, the newest
  std::vector<wire::RequestOutcome> requests;  ///< decided in that session, ascending by seq
};

/// The decisions kept with a map, as it is served now.
struct KeptDecisions {
  MapId map;
  Epoch epoch;
  std::span<const DecisionRecord> decisions;
};
/// The `most` of them that were decided on last, by name, the latest at the end: whoever is active again
/// after a restart is known still, however many names there have been.
[[nodiscard]] std::vector<std::pair<std::string, ResumedClient>> resume_clients(
    std::span<const KeptDecisions> maps, size_t most);

/// The highest id of those that were given to labels by what is decided here; some may have been removed.
[[nodiscard]] LabelId last_label_of(std::span<const DecisionRecord> decisions);

/// The client that made the map, as far as that is kept: who is not known, and who brought it in or copied
/// it, is none.
[[nodiscard]] std::string maker_of(std::span<const DecisionRecord> decisions);

/// Makes a frame that was tracked in an earlier epoch one of the present: what was given an id after the last
/// save of that epoch is not what has the id now, and is left out. False when the frame cannot be used:
/// unknown epoch, or its reference keyframe is such a one.
[[nodiscard]] bool carry_over(std::span<const EpochRecord> epochs, Epoch tracked_in, Epoch present,
                              KeyframeInput* frame);

}  // namespace cairn
