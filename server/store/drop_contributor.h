// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/store/store.h"

namespace cairn {

/// Error for a client that has no keyframe in a map.
[[nodiscard]] Error no_contribution(const std::string& client, const std::string& map_name);

/// Takes a client's keyframes out of a map, for good: their images and measurements, the points that fewer
/// than two keyframes see then, the client's decisions and proposals, and the map's tags, which would bring
/// all that back. What others proposed stays. The rest gets new ids, in a new epoch of which no earlier id is
/// understood; `accept` is shown it first. Labels stay where they are. On return it is durable. Errors:
/// kNotFound (the client has none), kRefused (fewer than two keyframes would be left), kDamaged, kIo, those
/// of `accept`; nothing has happened then. As Store::roll_back() beside the thread that writes other maps.
[[nodiscard]] Status drop_contributor(Store* store, MapId map, const std::string& client,
                                      const AcceptState& accept = {});

}  // namespace cairn
