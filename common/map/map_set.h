// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <iterator>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/map/ids.h"

namespace cairn {

/// Some maps, or all that there are and will be. The empty set is none. A value.
class MapSet {
 public:
  [[nodiscard]] static MapSet all() { return MapSet(std::nullopt); }
  explicit MapSet(std::vector<MapId> maps) : MapSet(std::optional(std::move(maps))) {
    std::ranges::sort(*maps_);
    maps_->erase(std::unique(maps_->begin(), maps_->end()), maps_->end());
  }

  [[nodiscard]] bool contains(const MapId& map) const {
    return !maps_ || std::ranges::binary_search(*maps_, map);
  }
  /// Those of `maps` that belong to this set, in their order.
  [[nodiscard]] std::vector<MapId> among(std::span<const MapId> maps) const {
    std::vector<MapId> those;
    std::ranges::copy_if(maps, std::back_inserter(those), [this](const MapId& map) { return contains(map); });
    return those;
  }
  bool operator==(const MapSet&) const = default;

 private:
  explicit MapSet(std::optional<std::vector<MapId>> maps) : maps_(std::move(maps)) {}
  std::optional<std::vector<MapId>> maps_;  ///< ascending, each once; nothing: all
};

}  // namespace cairn
