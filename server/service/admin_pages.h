// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "common/map/snapshot.h"
#include "server/service/admin_reply.h"
#include "server/service/proposal_judge.h"
#include "server/store/store.h"

/// What operators are answered about versions, proposals and the store's files. Pure.
namespace cairn {

[[nodiscard]] nlohmann::json describe(const MapTag& tag);
/// Those beyond the number `after`. `tags`: ascending.
[[nodiscard]] wire::AdminReply page_of(std::span<const MapTag> tags, uint64_t after);

/// Who brought which keyframes of a map that are there.
struct Contributors {
  std::map<std::string, std::vector<uint64_t>> by_client;
  size_t others = 0;  ///< keyframes of which that is not known
};
[[nodiscard]] Contributors contributors_of(const MapSnapshot& map, std::span<const Contribution> known);
/// Those beyond the name `after`.
[[nodiscard]] wire::AdminReply page_of(const Contributors& contributors, const std::string& after);

/// Those beyond `after`, in the order of a backup.
[[nodiscard]] wire::AdminReply page_of(std::span<const std::string> parts, const std::string& after);

[[nodiscard]] nlohmann::json describe(MapId map, const std::string& map_name,
                                      const ProposalSummary& proposal);
/// x, y and whether it was found, of each.
[[nodiscard]] nlohmann::json describe(std::span<const ExpectedPoint> points);

}  // namespace cairn
