// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>

#include "common/map/ids.h"
#include "common/map/label.h"
#include "server/access/access_policy.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/relocalizer.h"
#include "server/service/client_rates.h"
#include "server/service/clock.h"
#include "server/service/proposal_registry.h"
#include "server/service/wearer_rule.h"
#include "server/service/work_times.h"

namespace cairn {

/// How the maps of a store are made ready to be worked on and searched.
struct OpeningOptions {
  MapMakerOptions mapping;
  GravityOptions gravity;
};

/// How the map service works, whatever it is reached by.
struct MapServiceOptions {
  uint64_t seed = 0;  ///< of map ids; 0: as `entropy` has it, which must be there then
  std::function<uint32_t()> entropy = {};
  ServerId server;           ///< without a store: new with every start
  uint64_t start_count = 1;  ///< without a store: larger with every start, the epoch of its maps
  size_t max_maps = 1000;
  size_t max_maps_per_client = 200;  ///< made by it and not deleted; beyond, it makes none
  size_t max_memory_bytes = std::numeric_limits<size_t>::max();  ///< of all maps; beyond, none grows
  size_t max_keyframes = 2000;                                   ///< of a map
  size_t max_labels = kMaxLabels;                                ///< of a map; not more than that
  /// Most bytes of seeds, offers and proposals that have not been judged yet; beyond, none is taken.
  size_t max_waiting_bytes = 256'000'000;
  RateLimits rates;  ///< of each client
  /// With a store: the images of a map that nobody has offered anything to for so long, and that has nothing
  /// to do, are evicted until it has again; 0: never.
  std::chrono::seconds idle_after{60};
  /// A nearly full map is compacted when it has not been used for so long: what a client that is cut off
  /// keeps for it would be refused as of another epoch, and is rarely older.
  std::chrono::seconds compact_after{std::chrono::hours(24)};
  /// A map that its maker lost at once (YoungMaps) is deleted when that has been elsewhere for so long; 0:
  /// never. What is made in lockstep stays, since a replay does not go by this clock.
  std::chrono::seconds drop_after{0};
  /// With a store: what has been deleted for so long is purged; 0: operators do that.
  std::chrono::hours keep_deleted{0};
  bool lockstep = true;  ///< whether clients may ask for it; who does is not served otherwise
  MapMakerOptions mapping;
  RelocOptions relocalization;
  WearerOptions wearers;
  ProposalLimits proposals = {};
  std::shared_ptr<const AccessPolicy> access = {};  ///< nothing: the rights of the site
  std::shared_ptr<const Clock> clock = {};
  WorkTimes* work_times = nullptr;  ///< where the map makers' work is counted; outlives the service

  [[nodiscard]] OpeningOptions opening() const { return {mapping, relocalization.confirm.gravity}; }
};

}  // namespace cairn
