// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/mapping/map_record.h"
#include "server/store/store.h"

namespace cairn {

/// What a map loses when it is written anew.
struct MapRewrite {
  /// Takes it out of the map. Error: the map stays as it is.
  std::function<Status(const StoredMap& stored, MapState* state)> take_out;
  /// What becomes of what was decided, of which the ids are others now.
  std::function<void(const Renumbering& now, std::vector<DecisionRecord>* decisions)> follow;
  std::string dropped_client = {};  ///< whose proposals go, too; empty: nobody's
  bool is_changed = true;           ///< what is left is to be adjusted anew
};

/// Writes a map anew without what goes, and without the places of what had been removed before: the rest gets
/// new ids, in a new epoch of which no earlier id is understood; `accept` is shown it first. Labels stay
/// where they are, work that was due stays so, tags go. On return it is durable. Errors: of `take_out` and
/// `accept`, kDamaged, kIo; nothing has happened then. As Store::roll_back() beside the thread that writes
/// other maps.
[[nodiscard]] Status rewrite_map(Store* store, MapId map, const MapRewrite& how, const AcceptState& accept);

}  // namespace cairn
