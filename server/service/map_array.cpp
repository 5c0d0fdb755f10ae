// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_array.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <string_view>
#include <utility>

#include "server/relocalization/place_index.h"

namespace cairn {
namespace {

std::mt19937_64 make_generator(uint64_t seed, const std::function<uint32_t()>& entropy) {
  if (seed != 0 || !entropy) return std::mt19937_64(seed);
  std::seed_seq sequence{entropy(), entropy(), entropy(), entropy(),
                         entropy(), entropy(), entropy(), entropy()};
  return std::mt19937_64(sequence);
}

MapId draw_id(std::mt19937_64& generator) {
  MapId id;
  for (size_t half = 0; half < 2; ++half) {
    const uint64_t bits = generator();
    for (size_t i = 0; i < 8; ++i) id.bytes[8 * half + i] = static_cast<uint8_t>(bits >> (8 * i));
  }
  return id;
}

constexpr std::string_view kStem = "map-";  ///< of names that nobody wished for

std::string numbered(std::string_view stem, uint64_t number) {
  return std::string(stem) + std::to_string(number);
}

size_t published_bytes(const MapSnapshotPtr& snapshot) {
  size_t points = 0;
  if (snapshot == nullptr) return points;
  for (const auto& block : snapshot->point_blocks) points += block->patches->points.size();
  return points * (sizeof(PointSource) + sizeof(Eigen::Vector3f) + sizeof(PointVisibility));
}

/// FNV-1a of times and trails.
uint64_t digest(const wire::MapSeed& seed) {
  uint64_t hash = 0xcbf29ce484222325;
  const auto mix = [&hash](uint64_t word) {
    for (int byte = 0; byte < 8; ++byte) {
      hash = (hash ^ (word >> (8 * byte) & 0xff)) * 0x100000001b3;
    }
  };
  mix(static_cast<uint64_t>(seed.first_time.nanoseconds));
  mix(static_cast<uint64_t>(seed.second_time.nanoseconds));
  for (const Trail& trail : seed.trails) {
    for (const float coordinate : {trail.first.x(), trail.first.y(), trail.second.x(), trail.second.y()}) {
      mix(std::bit_cast<uint32_t>(coordinate));
    }
  }
  return hash;
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

MapArray::MapArray(uint64_t seed, const std::function<uint32_t()>& entropy)
    : seeded_(seed != 0), random_(make_generator(seed, entropy)) {}

MapId MapArray::next_id() {
  return draw_unused(&random_);
}

MapId MapArray::draw_unused(std::mt19937_64* generator) const {
  MapId id = draw_id(*generator);
  // A seed draws again what a restart has brought back, or what was deleted.
  while (maps_.contains(id) || reserved_.contains(id)) id = draw_id(*generator);
  return id;
}

MapId MapArray::repeatable_id(const wire::MapSeed& seed) {
  if (seeded_) return next_id();
  std::mt19937_64 generator(digest(seed));
  return draw_unused(&generator);
}

MapEntry& MapArray::add(MapId map, MapEntry entry) {
  remove(map);
  MapEntry& added = maps_.emplace(map, std::move(entry)).first->second;
  added.bytes_published = published_bytes(added.snapshot);
  bytes_ += bytes_of(added);
  take_name(added.name);
  return added;
}

void MapArray::remove(MapId map) {
  const auto known = maps_.find(map);
  if (known == maps_.end()) return;
  const MapEntry entry = std::move(known->second);
  maps_.erase(known);
  bytes_ -= bytes_of(entry);
  // Replicas have it, and another of that id would begin in an epoch that this one may have had.
  if (entry.snapshot != nullptr) reserve(map);
  give_back_name(entry.name);
  if (!entry.name_to_be.empty()) give_back_name(entry.name_to_be);
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
  take_name(name);
  entry->name_to_be = name;
}

void MapArray::end_renaming(MapEntry* entry, bool kept) {
  if (kept) std::swap(entry->name, entry->name_to_be);
  give_back_name(std::exchange(entry->name_to_be, {}));
}

void MapArray::take_name(const std::string& name) {
  taken_.insert(name);
  while (taken_.contains(numbered(kStem, first_number_))) ++first_number_;
}

void MapArray::give_back_name(const std::string& name) {
  const auto taken = taken_.find(name);
  if (taken != taken_.end()) taken_.erase(taken);
  if (!name.starts_with(kStem)) return;
  uint64_t number = 0;
  const auto [end, problem] = std::from_chars(name.data() + kStem.size(), name.data() + name.size(), number);
  const bool is_number = problem == std::errc() && end == name.data() + name.size();
  if (is_number && number > 0 && number < first_number_ && is_free(numbered(kStem, number)))
    first_number_ = number;
}

bool MapArray::is_free(const std::string& name) const {
  if (taken_.contains(name)) return false;
  const auto id = from_hex(name);
  return !id || !maps_.contains(MapId{*id});
}

std::string MapArray::free_name(const std::string& wish) const {
  const bool wished = is_valid_name(wish);
  if (!wished) return numbered(kStem, first_number_);
  if (is_free(wish)) return wish;
  const std::string stem = wish.substr(0, 24) + "-";
  // Someone's desk-2 may stand among ours: count up until a name is free.
  for (uint64_t number = 2;; ++number) {
    std::string name = numbered(stem, number);
    if (is_free(name)) return name;
  }
}

MapEntry* MapArray::find(MapId map) {
  const auto it = maps_.find(map);
  return it == maps_.end() ? nullptr : &it->second;
}

size_t MapArray::live_count() const {
  return static_cast<size_t>(std::count_if(
      maps_.begin(), maps_.end(), [](const auto& entry) { return entry.second.snapshot != nullptr; }));
}

size_t MapArray::resting_count() const {
  return static_cast<size_t>(
      std::count_if(maps_.begin(), maps_.end(), [](const auto& entry) { return is_at_rest(entry.second); }));
}

bool is_at_rest(const MapEntry& entry) {
  return entry.statistics.without_images > 0;
}

size_t bytes_of(const MapEntry& entry) {
  size_t sum =
      entry.statistics.bytes + bytes_indexed(entry.statistics.keyframes, entry.statistics.measurements);
  if (entry.offers_in_work > 0) sum += entry.statistics.bytes_let_go;
  return sum + entry.bytes_published;
}

size_t bytes_to_wake(const MapEntry& entry) {
  return entry.offers_in_work > 0 ? 0 : entry.statistics.bytes_let_go;
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
