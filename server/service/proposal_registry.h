// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/map/ids.h"
#include "server/store/proposal.h"

namespace cairn {

/// How much is kept aside, and for how long.
struct ProposalLimits {
  std::chrono::milliseconds interval{2000};  ///< between two of one client that are looked at
  size_t per_client = 32;                    ///< of a client, in a map
  size_t per_map = 256;
  uint64_t bytes_per_client = 16'000'000;  ///< likewise
  uint64_t bytes_per_map = 64'000'000;
  uint64_t bytes_in_all = 1'000'000'000;
  std::chrono::hours keep{30 * 24};
};

/// Which keyframes are kept aside, whether there is room for another, and which go for it: the oldest of the
/// client that has the most. Pure; used from one thread.
class ProposalRegistry {
 public:
  explicit ProposalRegistry(const ProposalLimits& limits = {}) : limits_(limits) {}

  /// Takes over a map's proposals from the store, in place of what was known of it. `last`: the highest
  /// number that the map has ever given to one. No number is given again.
  void restore(MapId map, std::vector<ProposalSummary> proposals, uint64_t last);
  /// Forgets the proposals of a map that has gone.
  void forget(MapId map);

  /// Why nothing of a client is looked at now; empty: it is, and the time counts from now on.
  [[nodiscard]] std::string why_not_now(const std::string& client, MonotonicTime now);
  /// Why there is no room for any; empty: there is.
  [[nodiscard]] std::string why_full() const;
  /// A proposal that shows about the same from about the same place; null: there is none.
  [[nodiscard]] const ProposalSummary* find_alike(MapId map, const ProposalSummary& proposal) const;

  struct Room {
    uint64_t number = 0;                ///< of the new one
    std::vector<ProposalSummary> gone;  ///< for it
  };
  /// Takes in a proposal that is about to be kept.
  [[nodiscard]] Room add(MapId map, ProposalSummary proposal);
  /// Takes a proposal back that is not kept after all: those that went for it are there again.
  void take_back(MapId map, const Room& room);
  void remove(MapId map, uint64_t number);
  /// Numbers of proposals that have been kept long enough, by map.
  [[nodiscard]] std::map<MapId, std::vector<uint64_t>> too_old(Timestamp now) const;

  using OfMap = std::map<uint64_t, ProposalSummary>;  ///< by number
  [[nodiscard]] const OfMap& of(MapId map) const;
  [[nodiscard]] const ProposalSummary* find(MapId map, uint64_t number) const;
  /// Number of proposals in all maps.
  [[nodiscard]] size_t count() const;

 private:
  struct MapPart {
    uint64_t last = 0;
    OfMap proposals;
  };
  /// The proposal that goes next to make room for one of `client`; the end: there is room.
  [[nodiscard]] OfMap::const_iterator next_to_go(const OfMap& proposals, const std::string& client) const;

  ProposalLimits limits_;
  std::map<MapId, MapPart> maps_;
  std::map<std::string, MonotonicTime> looked_at_;  ///< when, of each client, last
};

/// How operators call a proposal: the first digits of the map's id, and its number.
[[nodiscard]] std::string proposal_id(MapId map, uint64_t number);

}  // namespace cairn
