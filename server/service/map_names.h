// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <random>
#include <set>
#include <string>

#include "common/map/ids.h"
#include "common/wire/messages.h"

namespace cairn {

/// Gives out ids of maps, none twice while it is in use, or ever where it is reserved. With a seed, they are
/// the same on every run; with 0 they are as `entropy` has it. Used from one thread.
class MapIds {
 public:
  explicit MapIds(uint64_t seed, const std::function<uint32_t()>& entropy = {});

  [[nodiscard]] MapId next();
  /// The id of a map that a seed in lockstep makes: without a seed of our own, a digest of what the tracker
  /// saw (its times and trails), so that runs on fresh servers are equal to the byte. Another one if that is
  /// taken.
  [[nodiscard]] MapId repeatable(const wire::MapSeed& seed);
  /// Reserves the id of a map that was deleted and may come back: it is not given to another.
  void reserve(MapId map) { reserved_.insert(map); }
  void take(MapId map) { in_use_.insert(map); }
  void give_back(MapId map) { in_use_.erase(map); }
  [[nodiscard]] bool is_in_use(MapId map) const { return in_use_.contains(map); }

 private:
  [[nodiscard]] MapId draw_unused(std::mt19937_64* generator) const;

  const bool seeded_;
  std::mt19937_64 random_;
  std::set<MapId> in_use_;
  std::set<MapId> reserved_;
};

/// The names of maps, and names to be. Used from one thread.
class MapNames {
 public:
  /// `ids`: operators call a map by its id, too. It outlives this.
  explicit MapNames(const MapIds& ids) : ids_(ids) {}
  MapNames(const MapNames&) = delete;
  MapNames& operator=(const MapNames&) = delete;

  /// The wished name if it is valid (is_valid_name) and free, else that with a number, else the first free of
  /// map-1, map-2, ...
  [[nodiscard]] std::string free(const std::string& wish) const;
  /// Whether no map is called so, or has it for its id: also of those that are being made.
  [[nodiscard]] bool is_free(const std::string& name) const;
  void take(const std::string& name);
  void give_back(const std::string& name);

 private:
  const MapIds& ids_;
  std::multiset<std::string> taken_;
  uint64_t first_number_ = 1;  ///< of the maps that are map-1, map-2, ...: all before are taken
};

}  // namespace cairn
