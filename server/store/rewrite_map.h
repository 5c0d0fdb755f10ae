// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/mapping/map_record.h"
#include "server/store/store.h"

namespace cairn {

/// How a map is written anew, and what it loses by that.
struct MapRewrite {
  /// Takes out of the map what it loses. Error: the map stays as it is.
  std::function<Status(const StoredMap& stored, MapState* state)> take_out;
  /// Changes the decisions, whose ids are others now.
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
