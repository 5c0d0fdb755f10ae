// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/map/snapshot.h"
#include "common/wire/messages.h"
#include "server/access/rights.h"
#include "server/service/label_registry.h"
#include "server/service/map_names.h"
#include "server/service/map_runner.h"

namespace cairn {

/// How offers to a map were answered of late.
class OfferTimes {
 public:
  void note(std::chrono::nanoseconds wait, bool accepted);
  [[nodiscard]] uint64_t accepted() const { return accepted_; }  ///< since the map is served
  /// A quantile (0 to 1) of the last waits [ms]; nothing where there were none.
  [[nodiscard]] std::optional<double> wait_ms(double quantile) const;

 private:
  static constexpr size_t kKept = 100;
  std::deque<double> waits_;
  uint64_t accepted_ = 0;
};

/// One map of the server as the service's thread sees it. What MapArray sums up (name, snapshot, statistics,
/// offers_in_work, name_to_be) is changed by its methods only.
struct MapEntry {
  std::string name;
  std::shared_ptr<MapRunner> runner;  ///< null: fed from outside, takes no keyframes
  MapSnapshotPtr snapshot;            ///< null while its seed is being judged or kept
  MapStatistics statistics;
  bool plane_aligned = false;
  LabelRegistry labels{};
  bool seeding = false;                        ///< its seed has not been decided: nobody sees it
  std::optional<MapRevision> undecided = {};   ///< its newest revision, while seeding
  std::string failed = {};                     ///< why it takes nothing any more; empty: it does
  MonotonicTime used_at = {};                  ///< when it last changed or was offered a keyframe
  std::optional<Timestamp> localized_at = {};  ///< when a tracker last said that it is found in it
  OfferTimes offer_times{};
  int offers_in_work = 0;                ///< each may have its images paged in
  std::string name_to_be = {};           ///< while it is being kept: taken already
  bool leaving = false;                  ///< it is being deleted
  bool rolling_back = false;             ///< another state of it is about to take its place
  std::string maker = {};                ///< the client that made it; empty: an operator, or it is not known
  std::vector<EpochRecord> epochs = {};  ///< of the map; empty: the present one only
  size_t bytes_published = 0;            ///< of the snapshot's points
};

/// Refusal of requests about a map of which another state is about to take its place.
inline constexpr const char* kRollingBack = "another state of the map is about to take its place; try again";

/// Memory that a map takes as it is served [bytes]: the map maker's (without images while it is idle and has
/// been offered nothing), its published copy, its part of the place index.
[[nodiscard]] size_t bytes_of(const MapEntry& entry);

/// Memory [bytes] that an offer to an idle map takes beside that of its keyframe: the evicted images are
/// paged in for it. 0 while an offer is in work already, since bytes_of() counts them then.
[[nodiscard]] size_t bytes_to_page_in(const MapEntry& entry);

/// Whether images of the map are evicted.
[[nodiscard]] bool is_idle(const MapEntry& entry);

/// The maps by id. Used from one thread.
class MapArray {
 public:
  /// Arguments are those of MapIds.
  explicit MapArray(uint64_t seed, const std::function<uint32_t()>& entropy = {}) : ids_(seed, entropy) {}

  [[nodiscard]] MapIds& ids() { return ids_; }
  [[nodiscard]] const MapNames& names() const { return names_; }

  /// Adds a map, in place of one that has the id.
  MapEntry& add(MapId map, MapEntry entry);
  /// Removes a map. The id of one that has been shown is not given to another.
  void remove(MapId map);
  /// Sets the newest revision of a map.
  void show(MapEntry* entry, MapSnapshotPtr snapshot, MapStatistics statistics);
  void measured(MapEntry* entry, MapStatistics statistics);
  void begin_offer(MapEntry* entry);
  void end_offer(MapEntry* entry);
  /// Reserves a name that the map is about to have, and no other gets; end_renaming() must follow.
  void begin_renaming(MapEntry* entry, const std::string& name);
  /// Ends a renaming. `kept`: the map has the new name from now on; else the old one.
  void end_renaming(MapEntry* entry, bool kept);
  [[nodiscard]] MapEntry* find(MapId map);
  [[nodiscard]] const std::map<MapId, MapEntry>& all() const { return maps_; }
  /// Number of maps that have been shown; those whose seed is being decided are not among them.
  [[nodiscard]] size_t live_count() const;
  [[nodiscard]] size_t idle_count() const;
  /// Memory of all maps, as they were last published. Costs nothing.
  [[nodiscard]] size_t bytes() const { return bytes_; }

 private:
  template <typename Change>
  void change(MapEntry* entry, Change make) {
    bytes_ -= bytes_of(*entry);
    make();
    bytes_ += bytes_of(*entry);
  }

  MapIds ids_;
  MapNames names_{ids_};
  std::map<MapId, MapEntry> maps_;
  size_t bytes_ = 0;  ///< bytes_of() all entries
};

/// Finds a map that has been shown, by its name or id. Null: there is none.
[[nodiscard]] std::pair<MapId, MapEntry*> find_called(MapArray& maps, const std::string& name_or_id);

/// The message that a client with this right gets about a map that has been made.
[[nodiscard]] wire::MapInfo make_map_info(ServerId server, MapId map, const MapEntry& entry, Right right);

}  // namespace cairn
