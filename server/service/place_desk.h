// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "server/relocalization/relocalizer.h"
#include "server/service/worker_pool.h"

namespace cairn {

/// A question where a picture was taken, from the wire.
struct PlaceQuery {
  CameraPtr camera;
  PlaceView view;
  SearchScope scope;
  bool lockstep = false;  ///< answered with all that has been reported, not with what is indexed yet
};

/// The relocalizer at work: keeps the index over all maps and answers questions, each on workers of its own
/// lane and never on a map's queue: who is lost waits neither for map work nor for an index in the making.
/// Queries read an immutable index; a new one is made beside them. Thread-safe; tasks keep it alive.
class PlaceDesk : public std::enable_shared_from_this<PlaceDesk> {
 public:
  using Done = std::function<void(PlaceAnswer answer)>;

  PlaceDesk(WorkerPool& indexers, WorkerPool& answerers, const RelocOptions& options, Logger log)
      : indexers_(indexers), answerers_(answerers), options_(options), log_(std::move(log)) {}

  /// A new state of a map. One that has not been indexed yet is passed over: only the newest counts.
  void report(MapSnapshotPtr snapshot, std::vector<KeyframeView> views);
  /// The map is gone: soon no question is answered with it. Does not wait.
  void remove(const MapId& map);
  /// `done` is called on an answerer, whatever happens.
  void ask(PlaceQuery query, Done done);

 private:
  struct Reported {
    MapSnapshotPtr snapshot;  ///< null: the map is gone
    std::vector<KeyframeView> views;
  };
  void note(const MapId& map, Reported reported);
  /// Indexes what has been reported. One thread at a time; others wait.
  void catch_up();
  [[nodiscard]] std::shared_ptr<const PlaceIndex> index() const;

  WorkerPool& indexers_;
  WorkerPool& answerers_;
  const RelocOptions options_;
  Logger log_;

  std::mutex catching_up_;  ///< held while indexing; before mutex_

  mutable std::mutex mutex_;  ///< of what follows; held for moments
  std::map<MapId, Reported> reported_;
  bool scheduled_ = false;
  std::shared_ptr<const PlaceIndex> index_ = std::make_shared<PlaceIndex>();
};

}  // namespace cairn
