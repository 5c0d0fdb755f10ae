// SPDX-License-Identifier: Apache-2.0
#include "server/service/overlap_list.h"

#include <algorithm>
#include <utility>

namespace cairn {

void OverlapList::restore(const std::vector<OverlapRecord>& records) {
  for (const OverlapRecord& record : records) overlaps_[pair_of(record.one, record.other)] = record;
}

bool OverlapList::note(const Overlap& overlap, Timestamp now) {
  const OverlapRecord fresh{overlap.maps.one, overlap.maps.other, 0, 0, now};
  const auto [at, is_new] = overlaps_.try_emplace(overlap.maps, fresh);
  OverlapRecord& record = at->second;
  const OverlapRecord before = record;
  record.of_one = std::max(record.of_one, static_cast<uint32_t>(overlap.of_one));
  record.of_other = std::max(record.of_other, static_cast<uint32_t>(overlap.of_other));
  is_changed_ = is_changed_ || is_new || record != before;
  return is_new;
}

void OverlapList::forget(const MapId& map) {
  const auto is_of_map = [&](const auto& entry) {
    return entry.first.one == map || entry.first.other == map;
  };
  is_changed_ = std::erase_if(overlaps_, is_of_map) > 0 || is_changed_;
}

std::vector<OverlapList::Neighbour> OverlapList::of(const MapId& map) const {
  std::vector<Neighbour> neighbours;
  for (const auto& [pair, record] : overlaps_) {
    if (pair.one == map) neighbours.push_back({pair.other, record.of_one, record.of_other, record.found});
    if (pair.other == map) neighbours.push_back({pair.one, record.of_other, record.of_one, record.found});
  }
  std::ranges::stable_sort(neighbours, [](const Neighbour& a, const Neighbour& b) {
    return a.keyframes + a.its_keyframes > b.keyframes + b.its_keyframes;
  });
  return neighbours;
}

std::vector<OverlapRecord> OverlapList::all() const {
  std::vector<OverlapRecord> records;
  for (const auto& [_, record] : overlaps_) records.push_back(record);
  return records;
}

bool OverlapList::take_changed() {
  return std::exchange(is_changed_, false);
}

}  // namespace cairn
