// SPDX-License-Identifier: Apache-2.0
#include "server/service/capacity.h"

#include <algorithm>

namespace cairn {

std::string Capacity::why_memory_is_full(size_t more) const {
  constexpr size_t kMegabyte = 1'000'000;
  const size_t bytes = maps_.bytes();
  if (bytes + more < options_.max_memory_bytes) return {};
  std::string why = "the server is full: its maps take " + std::to_string(bytes / kMegabyte) + " MB";
  if (more > 0)
    why += ", and this one, which is idle, needs " + std::to_string(more / kMegabyte) + " MB more";
  return why + " (--max-memory)";
}

std::string Capacity::why_map_is_full(const MapEntry& entry) const {
  const size_t keyframes = entry.statistics.keyframes;
  if (keyframes + static_cast<size_t>(entry.offers_in_work) >= options_.max_keyframes) {
    return "the map has " + std::to_string(keyframes) +
           " keyframes, which is all it may have (--max-keyframes)";
  }
  return why_memory_is_full(bytes_to_page_in(entry));
}

std::string Capacity::why_full() const {
  if (maps_.all().size() >= options_.max_maps)
    return "the server is full: " + std::to_string(maps_.all().size()) + " maps (--max-maps)";
  return why_memory_is_full();
}

std::string Capacity::why_maker_is_full(const std::string& client) const {
  const auto made =
      std::ranges::count_if(maps_.all(), [&](const auto& map) { return map.second.maker == client; });
  if (static_cast<size_t>(made) < options_.max_maps_per_client) return {};
  return "this client has made " + std::to_string(made) +
         " of the maps here, which is all that one may have (--max-maps-per-client)";
}

size_t Capacity::free_bytes() const {
  return options_.max_memory_bytes - std::min(maps_.bytes(), options_.max_memory_bytes);
}

}  // namespace cairn
