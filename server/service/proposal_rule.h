// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/wire/messages.h"
#include "server/access/rights.h"
#include "server/service/client.h"
#include "server/service/map_array.h"
#include "server/service/service_context.h"

/// Which offers are proposals: what a client is told of a map, and what is made of its offers, go by the same
/// rule.
namespace cairn {

/// Refusal of proposals where none are taken.
inline constexpr const char* kNoProposals = "no proposals are taken in this map";

/// Whether keyframes of a client are kept aside where it may not add them.
[[nodiscard]] bool takes_proposals(const ServiceContext& context, const Client& client, MapId map,
                                   const MapEntry& entry);

/// Why an offer can be a proposal at most; empty: the map maker is to judge it.
[[nodiscard]] std::string why_aside(const wire::KeyframeOffer& offer, const MapEntry& entry,
                                    const Ruling& ruling);

}  // namespace cairn
