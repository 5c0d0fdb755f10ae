// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_array.h"

#include <algorithm>
#include <utility>

#include "server/relocalization/place_index.h"

namespace cairn {
namespace {

size_t published_bytes(const MapSnapshotPtr& snapshot) {
  size_t points = 0;
  if (snapshot == nullptr) return points;
  for (const auto& block : snapshot->point_blocks) points += block->patches->points.size();
  return points * (sizeof(PointSource) + sizeof(Eigen::Vector3f) + sizeof(PointVisibility));
}

}  // namespace

void OfferTimes::note(std::chrono::nanoseconds wait, bool accepted) {
  waits_.push_back(std::chrono::duration<double, std::milli>(wait).count());
  if (waits_.size() > kKept) waits_.pop_front();
  accepted_ += accepted ? 1 : 0;
}

std::optional<double> OfferTimes::wait_ms(double quantile) const {
  if (waits_.empty()) return std::nullopt;
  std::vector<double> sorted(waits_.begin(), waits_.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted[static_cast<size_t>(quantile * static_cast<double>(sorted.size() - 1))];
}

MapEntry& MapArray::add(MapId map, MapEntry entry) {
  remove(map);
  MapEntry& added = maps_.emplace(map, std::move(entry)).first->second;
  added.bytes_published = published_bytes(added.snapshot);
  bytes_ += bytes_of(added);
  ids_.take(map);
  names_.take(added.name);
  return added;
}

void MapArray::remove(MapId map) {
  const auto known = maps_.find(map);
  if (known == maps_.end()) return;
  const MapEntry entry = std::move(known->second);
  maps_.erase(known);
  bytes_ -= bytes_of(entry);
  ids_.give_back(map);
  // Replicas have it, and another of that id would begin in an epoch that this one may have had.
  if (entry.snapshot != nullptr) ids_.reserve(map);
  names_.give_back(entry.name);
  if (!entry.name_to_be.empty()) names_.give_back(entry.name_to_be);
}

void MapArray::show(MapEntry* entry, MapSnapshotPtr snapshot, MapStatistics statistics) {
  change(entry, [&] {
    entry->snapshot = std::move(snapshot);
    entry->statistics = std::move(statistics);
    entry->bytes_published = published_bytes(entry->snapshot);
  });
}

void MapArray::measured(MapEntry* entry, MapStatistics statistics) {
  change(entry, [&] { entry->statistics = std::move(statistics); });
}

void MapArray::begin_offer(MapEntry* entry) {
  change(entry, [&] { ++entry->offers_in_work; });
}

void MapArray::end_offer(MapEntry* entry) {
  change(entry, [&] { --entry->offers_in_work; });
}

void MapArray::begin_renaming(MapEntry* entry, const std::string& name) {
  names_.take(name);
  entry->name_to_be = name;
}

void MapArray::end_renaming(MapEntry* entry, bool kept) {
  if (kept) std::swap(entry->name, entry->name_to_be);
  names_.give_back(std::exchange(entry->name_to_be, {}));
}

MapEntry* MapArray::find(MapId map) {
  const auto it = maps_.find(map);
  return it == maps_.end() ? nullptr : &it->second;
}

size_t MapArray::live_count() const {
  return static_cast<size_t>(std::count_if(
      maps_.begin(), maps_.end(), [](const auto& entry) { return entry.second.snapshot != nullptr; }));
}

size_t MapArray::idle_count() const {
  return static_cast<size_t>(
      std::count_if(maps_.begin(), maps_.end(), [](const auto& entry) { return is_idle(entry.second); }));
}

std::pair<MapId, MapEntry*> find_called(MapArray& maps, const std::string& name_or_id) {
  for (const auto& [id, entry] : maps.all()) {
    if (entry.snapshot != nullptr && (entry.name == name_or_id || to_hex(id.bytes) == name_or_id))
      return {id, maps.find(id)};
  }
  return {};
}

bool is_idle(const MapEntry& entry) {
  return entry.statistics.without_images > 0;
}

size_t bytes_of(const MapEntry& entry) {
  size_t sum =
      entry.statistics.bytes + bytes_indexed(entry.statistics.keyframes, entry.statistics.measurements);
  if (entry.offers_in_work > 0) sum += entry.statistics.evicted_bytes;
  return sum + entry.bytes_published;
}

size_t bytes_to_page_in(const MapEntry& entry) {
  return entry.offers_in_work > 0 ? 0 : entry.statistics.evicted_bytes;
}

wire::MapInfo make_map_info(ServerId server, MapId map, const MapEntry& entry, Right right) {
  wire::MapInfo info;
  info.map = map;
  info.name = entry.name;
  info.epoch = entry.snapshot->epoch;
  info.revision = entry.snapshot->revision;
  info.keyframes = static_cast<uint32_t>(entry.snapshot->keyframe_count());
  info.points = static_cast<uint32_t>(entry.snapshot->point_count());
  info.bounds_min = entry.statistics.bounds_min;
  info.bounds_max = entry.statistics.bounds_max;
  info.plane_aligned = entry.plane_aligned;
  info.metric = entry.snapshot->metric;
  info.right = right >= Right::kAdd    ? wire::MapRight::kWrite
               : right == Right::kRead ? wire::MapRight::kRead
                                       : wire::MapRight::kNone;
  info.server = server;
  return info;
}

}  // namespace cairn
