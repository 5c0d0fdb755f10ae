// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/place_index.h"
#include "server/service/executor.h"
#include "server/service/held_strand.h"
#include "server/service/service_options.h"
#include "server/store/store.h"

namespace cairn {

/// A map that the store has given back, ready to go on.
struct RestoredMap {
  MapHeader header;  ///< its epoch is the one that has just begun
  std::unique_ptr<MapMaker> maker;
  bool plane_aligned = false;
  std::vector<EpochRecord> epochs;
  std::vector<DecisionRecord> decisions;
  std::vector<LabelRecord> labels;
  std::vector<ProposalSummary> proposals;
  uint64_t last_proposal = 0;
  std::vector<Contribution> contributions;
  IndexedMapPtr indexed;  ///< its part of the place index, as it is now
};

/// What becomes of the images of maps from the store that have nothing to do.
[[nodiscard]] constexpr RestoredImages restored_images(std::chrono::seconds idle_after) {
  return idle_after.count() > 0 ? RestoredImages::kEvicted : RestoredImages::kStay;
}

/// Runs `work`; what it throws (memory, a library) is an error like others.
[[nodiscard]] Status guarded(const Logger& log, const std::function<Status()>& work);

/// Maps that come from the store: at the start, one by one, or in another state of theirs. What cannot be
/// loaded is set aside or left alone, and named. Thread-safe.
class MapOpening {
 public:
  /// Store, writer, strand and log that it works with; all outlive it.
  struct With {
    Store& store;
    std::function<void(std::function<void(Store& store)> task)> run;  ///< in the writer's turn
    std::shared_ptr<HeldStrand> strand;
    Logger log;
  };
  explicit MapOpening(With with) : with_(std::move(with)), unloaded_(with_.store.unplaced()) {}
  MapOpening(const MapOpening&) = delete;
  MapOpening& operator=(const MapOpening&) = delete;

  /// The result of Store::damaged_files().
  [[nodiscard]] std::vector<DamagedFile> damaged_files() const { return with_.store.damaged_files(); }
  /// Maps that could not be loaded, or put into their place (Store::unplaced()), while their files lie where
  /// they were. Looks at the folder.
  [[nodiscard]] std::vector<UnloadedMap> unloaded() const;
  /// Notes, and says in the log, that a map of the store is not served.
  void leave_alone(MapId map, const std::string& name, const std::string& reason);
  /// Store::decisions_on_deleted(), of so many that a start does not take long.
  [[nodiscard]] std::vector<DeletedDecisions> decisions_on_deleted() const;

  /// Restores all maps of the store, shared out by `parallel`, each in a new epoch. One that is damaged is
  /// set aside (logged with file, rows and where the copy is) and replaced by what could be saved of it, if
  /// anything. One that cannot be loaded for other reasons (a newer version, the disk, memory) is left alone:
  /// it is one of unloaded(). To be called once, before anything else.
  [[nodiscard]] std::vector<RestoredMap> restore(const OpeningOptions& options, const Parallel& parallel,
                                                 RestoredImages images = RestoredImages::kStay);

  /// Restores one map, after Store::undelete() or import_map(): to be called by the other thread
  /// (run_on_strand()). If it cannot be loaded, `undo` takes it back to where it was: nothing has happened
  /// then. `done` is called by the writer.
  using Undo = Status (Store::*)(MapId map);
  void restore_one(MapId map, const OpeningOptions& options, RestoredImages images, Undo undo,
                   std::function<void(Result<RestoredMap>)> done);
  /// Takes a map back that cannot be served, for this reason: `undo` puts it where it was; if that fails, the
  /// map is left alone. To be called by the writer.
  void take_back(MapId map, const std::string& name, Undo undo, const std::string& reason);

  /// Puts another state in place of a map's, which hands in nothing meanwhile. `change` does so beside the
  /// writer (Store::roll_back()) and shows that state first. `take` gets it, ready to be served, before it is
  /// durable. One that is damaged, or that `take` throws at, is not put there. `done` is called by the
  /// writer, with what has come of it: an error, and nothing has happened.
  struct StateChange {
    HeldStrand::Hold place;  ///< of hold_strand()
    std::function<Status(Store& store, const AcceptState& accept)> change;
    std::function<void(RestoredMap map)> take;
    std::function<void(const Status& changed)> done;
  };
  void change_state(MapId map, const OpeningOptions& options, RestoredImages images, StateChange how);

 private:
  struct Loaded;
  [[nodiscard]] Loaded load(MapId map, const OpeningOptions& options, RestoredImages images) const;
  [[nodiscard]] static Loaded make_ready(MapId map, Result<StoredMap> stored, const OpeningOptions& options,
                                         RestoredImages images);
  [[nodiscard]] Result<RestoredMap> settle(Loaded loaded);
  /// Parts with a map that cannot be loaded and has been there: sets it aside if it is damaged, else leaves
  /// it alone.
  void part_with(const Loaded& failed);
  void forget_unloaded(MapId map);

  const With with_;
  mutable std::mutex mutex_;  ///< of what follows
  std::vector<UnloadedMap> unloaded_;
};

}  // namespace cairn
