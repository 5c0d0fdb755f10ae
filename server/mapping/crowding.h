// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace cairn {

/// Whether more than three quarters of `most` places are taken, and more than a quarter by removed items.
/// These keep their places until the map is compacted; without that it would be full for good.
[[nodiscard]] constexpr bool is_crowded(size_t made, size_t live, size_t most) {
  return 4 * made > 3 * most && 4 * (made - live) > most;
}

}  // namespace cairn
