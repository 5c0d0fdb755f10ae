// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/relocalization/place_index.h"
#include "server/service/map_array.h"
#include "server/service/map_runner.h"
#include "server/service/published_maps.h"
#include "server/service/service_context.h"
#include "server/service/young_maps.h"

namespace cairn {

/// A map that the store has given back.
struct ResumedMap {
  MapHeader header;
  bool plane_aligned = false;
  std::vector<LabelRecord> labels;
  LabelId last_label;
  std::vector<ProposalSummary> proposals;
  uint64_t last_proposal = 0;
  std::vector<EpochRecord> epochs;
  std::string maker;
  std::shared_ptr<MapRunner> runner;
  MapRevision first;
};

/// The maps that are served: they come (made by a seed, given back by the store, fed from outside), change,
/// are idle and go, and whoever has to do with that is told. Used from the service's thread, unless said
/// otherwise.
class ServedMaps {
 public:
  struct Listener {
    /// Called when a map is about to be shown as the store has kept it.
    std::function<void(ResumedMap& map)> restored;
    /// Called when a map has another revision, which is the entry's by now.
    std::function<void(MapId map, MapEntry& entry, MapRevision revision)> shown;
    /// Called when a map has been deleted, or was never made (then nobody was told of it).
    std::function<void(MapId map, bool was_shown)> gone;
  };
  explicit ServedMaps(const ServiceContext& context)
      : context_(context),
        array_(context.options.seed, context.options.entropy),
        published_(context, array_) {}
  ServedMaps(const ServedMaps&) = delete;
  ServedMaps& operator=(const ServedMaps&) = delete;
  /// Sets the listener. To be called before anything else.
  void listen(Listener listener) { listener_ = std::move(listener); }

  [[nodiscard]] MapArray& array() { return array_; }
  [[nodiscard]] const MapArray& array() const { return array_; }
  [[nodiscard]] YoungMaps& young() { return young_; }
  [[nodiscard]] const PublishedMaps& published() const { return published_; }

  /// Makes the runner of a map. Thread-safe.
  [[nodiscard]] std::shared_ptr<MapRunner> make_runner(MapId map);
  /// Makes a map ready that the store gives back: the part that takes time. Thread-safe.
  [[nodiscard]] ResumedMap prepare(RestoredMap restored);
  void take_up(ResumedMap map);
  /// Puts another state of a map that is served in its place. Returns the ids of the labels of both states;
  /// nothing: the map has gone.
  [[nodiscard]] std::optional<std::set<LabelId>> replace(ResumedMap map);
  /// Shows another revision of a map, unless the map has gone or its seed is not decided yet.
  void change(MapId map, MapRevision revision);
  /// Forgets a map that has been deleted, or was never made.
  void forget(MapId map);

  /// Evicts the images of maps that have not been in use for long. `index`: what queries are answered with.
  void evict_idle_maps(MonotonicTime now, const PlaceIndex& index);
  /// Makes running work end soon.
  void stop();
  /// Hands what has changed to the store, when no executor runs any more.
  void save_last_changes();

 private:
  const ServiceContext& context_;
  Listener listener_;
  MapArray array_;
  PublishedMaps published_;
  YoungMaps young_;
  bool memory_freed_ = false;  ///< by evicted images, since memory was last given back
};

}  // namespace cairn
