// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace cairn {

/// Whether three quarters of `most` places are taken, and a quarter by what was made and does not live: what
/// is removed keeps its place until a map is compacted, which would be full for good otherwise.
[[nodiscard]] constexpr bool is_crowded(size_t made, size_t live, size_t most) {
  return 4 * made > 3 * most && 4 * (made - live) > most;
}

}  // namespace cairn
