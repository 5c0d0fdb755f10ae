// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "common/base/log.h"
#include "server/relocalization/relocalizer.h"
#include "server/service/clock.h"
#include "server/service/executor.h"
#include "server/service/work_times.h"

namespace cairn {

/// A relocalization query: where was this image taken, from the wire.
struct RelocalizationQuery {
  CameraPtr camera;
  PlaceView view;
  SearchScope scope;
  bool lockstep = false;  ///< answered with all that has been reported, not with what is indexed yet
};

/// The relocalizer at work: keeps the index over all maps and answers queries, each on workers of its own
/// executor and never on a map's queue: who is lost waits neither for map work nor for an index in the
/// making. Queries read an immutable index; a new one is made beside them, and where it has many images a
/// forest of them on the background executor: until that is done, what it will have is scanned. Thread-safe;
/// tasks keep it alive.
class RelocalizationRunner : public std::enable_shared_from_this<RelocalizationRunner> {
 public:
  using Done = std::function<void(RelocalizationAnswer answer)>;

  struct Executors {
    Executor& indexers;
    Executor& answerers;
    Executor& planters;  ///< of forests: a second of work that nobody waits for
  };
  /// Told what is searched, in order, by whoever has indexed it: others wait for that thread.
  struct Listener {
    std::function<void(const IndexedMapPtr& map, std::span<const KeyframeView> views)> searched;
    std::function<void(const MapId& map)> removed;
  };
  /// `times`: where it is counted how soon keyframes are searchable, if anywhere; outlives the runner.
  RelocalizationRunner(Executors executors, const RelocOptions& options, std::shared_ptr<const Clock> clock,
                       Logger log, WorkTimes* times = nullptr)
      : executors_(executors),
        options_(options),
        clock_(std::move(clock)),
        log_(std::move(log)),
        times_(times) {}
  /// Sets the listener. To be called before anything else.
  void listen(Listener listener) { listener_ = std::move(listener); }

  /// Takes in a new state of a map. One that has not been indexed yet is passed over: only the newest counts.
  /// Views without an image are of keyframes that are indexed, in `indexed` (what was indexed of the map
  /// elsewhere) or here, and stay as they are there; others are left out. `offered`: when the keyframes came
  /// that are new in it.
  void report(MapSnapshotPtr snapshot, std::vector<KeyframeView> views, IndexedMapPtr indexed = {},
              std::vector<MonotonicTime> offered = {});
  /// Removes a map that is gone: soon no query is answered with it. Does not wait.
  void remove(const MapId& map);
  /// Answers a query. `done` is called on an answerer, whatever happens.
  void ask(RelocalizationQuery query, Done done);
  /// The index with which a query would be answered now.
  [[nodiscard]] std::shared_ptr<const PlaceIndex> index() const;

 private:
  struct Reported {
    MapSnapshotPtr snapshot;  ///< null: the map is gone
    std::vector<KeyframeView> views;
    IndexedMapPtr indexed;
    std::vector<MonotonicTime> offered;  ///< also of states that were passed over
  };
  void note(const MapId& map, Reported reported);
  /// Indexes what has been reported. One thread at a time; others wait.
  void catch_up();
  /// Indexes a reported state of a map, or removes a map that is gone. Precondition: changing_ is held.
  void adopt(const MapId& map, const Reported& reported);
  /// Has a forest planted unless the index is well served or one is on its way. Precondition: changing_ is
  /// held.
  void plant_if_needed();
  void plant();
  /// Puts a planted forest into the index; nothing: planting failed.
  void adopt(std::optional<ImageForestPtr> forest);
  void publish(PlaceIndex next);

  const Executors executors_;
  const RelocOptions options_;
  const std::shared_ptr<const Clock> clock_;
  Logger log_;
  WorkTimes* const times_;
  Listener listener_;

  std::mutex changing_;    ///< held while a new index is made of the one there is; before mutex_
  bool planting_ = false;  ///< under changing_

  mutable std::mutex mutex_;  ///< of what follows; held for moments
  std::map<MapId, Reported> reported_;
  bool scheduled_ = false;
  std::shared_ptr<const PlaceIndex> index_ = std::make_shared<PlaceIndex>();
};

}  // namespace cairn
