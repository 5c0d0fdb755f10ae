// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "common/wire/messages.h"
#include "server/mapping/expected_points.h"
#include "server/store/map_file.h"

/// What a keyframe that is not to be added is worth, by what is published of the map: no map maker is asked,
/// and no builder waits. Pure, on any thread.
namespace cairn {

struct ProposalJudgement {
  wire::OfferDecision decision = wire::OfferDecision::kKeptAside;
  std::string reason;  ///< of a refusal
  KeptProposal kept;   ///< but for who, why, when and its number
};

/// `camera`: whose values are exact. `options`: as the map maker looks for known points.
[[nodiscard]] ProposalJudgement judge_proposal(const MapSnapshot& map, const Camera& camera,
                                               const wire::KeyframeOffer& offer,
                                               const RefindOptions& options);

/// The points of the map as it is now in the image of a proposal. `epochs`: of the map, by which it is
/// known what ids of an earlier one mean now. Errors: kRefused (its place in the map has gone), kDamaged.
[[nodiscard]] Result<std::vector<ExpectedPoint>> points_in(const MapSnapshot& map,
                                                           std::span<const EpochRecord> epochs,
                                                           const KeptProposal& proposal,
                                                           const RefindOptions& options);

}  // namespace cairn
