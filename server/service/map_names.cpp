// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_names.h"

#include <bit>
#include <charconv>
#include <string_view>

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

MapIds::MapIds(uint64_t seed, const std::function<uint32_t()>& entropy)
    : seeded_(seed != 0), random_(make_generator(seed, entropy)) {}

MapId MapIds::next() {
  return draw_unused(&random_);
}

MapId MapIds::draw_unused(std::mt19937_64* generator) const {
  MapId id = draw_id(*generator);
  // A seed draws again what a restart has brought back, or what was deleted.
  while (in_use_.contains(id) || reserved_.contains(id)) id = draw_id(*generator);
  return id;
}

MapId MapIds::repeatable(const wire::MapSeed& seed) {
  if (seeded_) return next();
  std::mt19937_64 generator(digest(seed));
  return draw_unused(&generator);
}

void MapNames::take(const std::string& name) {
  taken_.insert(name);
  while (taken_.contains(numbered(kStem, first_number_))) ++first_number_;
}

void MapNames::give_back(const std::string& name) {
  const auto taken = taken_.find(name);
  if (taken != taken_.end()) taken_.erase(taken);
  if (!name.starts_with(kStem)) return;
  uint64_t number = 0;
  const auto [end, problem] = std::from_chars(name.data() + kStem.size(), name.data() + name.size(), number);
  const bool is_number = problem == std::errc() && end == name.data() + name.size();
  if (is_number && number > 0 && number < first_number_ && is_free(numbered(kStem, number)))
    first_number_ = number;
}

bool MapNames::is_free(const std::string& name) const {
  if (taken_.contains(name)) return false;
  const auto id = from_hex(name);
  return !id || !ids_.is_in_use(MapId{*id});
}

std::string MapNames::free(const std::string& wish) const {
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

}  // namespace cairn
