// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/store/store.h"

namespace cairn {

/// Gives up the places of what was removed from a map, which would be full one day otherwise: all that lives
/// gets new ids, in a new epoch; what was decided and proposed is told with these, and work that is due stays
/// due. Errors: kRefused where the map has tags, which would go; as of rewrite_map().
[[nodiscard]] Status compact_map(Store* store, MapId map, const AcceptState& accept = {});

}  // namespace cairn
