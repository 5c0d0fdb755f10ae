// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/place_index.h"
#include "server/service/clock.h"
#include "server/service/executor.h"
#include "server/service/held_lane.h"
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

/// Of maps from the store that have nothing to do.
[[nodiscard]] constexpr RestoredImages restored_images(std::chrono::seconds rest_after) {
  return rest_after.count() > 0 ? RestoredImages::kLetGo : RestoredImages::kStay;
}

/// The store at work: one writer writes what the queues of all maps hand in. What has come of a map while
/// others were being written goes into its next transaction together (group commit): a caller waits for two
/// commits of each map that has something to write, at most, however many updates there are. Whole files are
/// read and written by another executor beside it. Thread-safe.
class MapPersistence {
 public:
  /// Called by the writer when the update is durable, or with the reason why it is not.
  using Done = std::function<void(Status)>;
  /// Changes that no answer waits for are saved after this time at the latest (5 s). While nothing can be
  /// kept, the store is tried again as often.
  static constexpr std::chrono::seconds kSaveDelay{2};
  static constexpr size_t kReadPerTurn = size_t{4} << 20;  ///< [bytes] by read_images(), and one row beyond

  /// What it works with. The clock is that of the turns.
  struct Runtime {
    std::shared_ptr<const Clock> clock;
    std::unique_ptr<Turns> writer;
    std::unique_ptr<Executor> beside;    ///< one task at a time
    std::unique_ptr<Executor> examiner;  ///< likewise
  };
  /// Errors: as Store::open().
  [[nodiscard]] static Result<std::unique_ptr<MapPersistence>> start(const std::filesystem::path& folder,
                                                                     Runtime runtime, Logger log);
  /// Writes what waits, then ends.
  ~MapPersistence();
  MapPersistence(const MapPersistence&) = delete;
  MapPersistence& operator=(const MapPersistence&) = delete;

  [[nodiscard]] ServerId server() const { return server_; }
  [[nodiscard]] uint64_t start_count() const { return start_count_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// As Store::damaged_files().
  [[nodiscard]] std::vector<DamagedFile> damaged_files() const { return store_->damaged_files(); }
  /// Maps that could not be loaded, or put into their place (Store::unplaced()), while their files lie where
  /// they were. Looks at the folder.
  [[nodiscard]] std::vector<UnloadedMap> unloaded() const;
  /// Notes, and says in the log, that a map of the store is not served.
  void leave_alone(MapId map, const std::string& name, const std::string& reason);
  /// Maps that had been deleted before the start: their ids are not given again.
  [[nodiscard]] const std::vector<MapId>& deleted_ids() const { return deleted_ids_; }

  /// Store::overlaps().
  [[nodiscard]] const std::vector<OverlapRecord>& overlaps() const { return overlaps_; }

  /// All maps of the store, shared out by `parallel`, each under a new epoch. One that is damaged is set
  /// aside (logged with file, rows and where the copy is) and replaced by what could be saved of it, if
  /// anything. One that cannot be loaded for other reasons (a newer version, the disk, memory) is left alone:
  /// it is one of unloaded(). To be called once, before anything else.
  [[nodiscard]] std::vector<RestoredMap> restore(const MapMakerOptions& options, const Parallel& parallel,
                                                 RestoredImages images = RestoredImages::kStay);

  /// One map, after Store::undelete() or import_map(): to be called by the other thread (run_beside()). If it
  /// cannot be loaded, `undo` takes it back to where it was: nothing has happened then. `done` is called by
  /// the writer.
  using Undo = Status (Store::*)(MapId map);
  void restore_one(MapId map, const MapMakerOptions& options, RestoredImages images, Undo undo,
                   std::function<void(Result<RestoredMap>)> done);
  /// The same for one that was loaded and cannot be served after all, for this reason: by the writer.
  void take_back(MapId map, const std::string& name, Undo undo, const std::string& reason);

  /// Puts another state in place of a map's, which hands in nothing meanwhile. `change` does so beside the
  /// writer (Store::roll_back()) and shows that state first. `take` gets it, ready to be served, before it is
  /// durable. One that is damaged, or that `take` throws at, is not put there. `done` is called by the
  /// writer, with what has come of it: an error, and nothing has happened.
  struct StateChange {
    HeldLane::Hold place;  ///< of hold_beside()
    std::function<Status(Store& store, const AcceptState& accept)> change;
    std::function<void(RestoredMap map)> take;
    std::function<void(const Status& changed)> done;
  };
  void change_state(MapId map, const MapMakerOptions& options, RestoredImages images, StateChange how);

  /// Images that have been let go: the first of these keyframes' (Store::read_images()), as many as others
  /// that have something to write can wait for: no longer than a commit takes. `done` is called by the
  /// writer, in its turn: with all that was handed in before, whatever happens. Error kIo: it may be over
  /// soon.
  using ImagesRead = std::function<void(Result<std::vector<ImageRow>> rows)>;
  void read_images(MapId map, std::vector<KeyframeId> keyframes, ImagesRead done);

  void create(MapHeader header, MapUpdate whole, Done done);
  void write(MapId map, MapUpdate update, Done done);
  /// Anything else to be done with the store, in its turn. A task that throws is logged and ends alone.
  void run(std::function<void(Store& store)> task);
  /// What takes seconds and leaves open maps alone (archives, deleted maps), one task after another, while
  /// maps are being written; dropped at the end.
  void run_beside(std::function<void(Store& store)> task);
  /// Waits for all that: `then` is called by that thread, and nothing else begins there while its `place`
  /// lives. For what a map is stopped for: it is stopped after the wait.
  void hold_beside(std::function<void(HeldLane::Hold place)> then);
  /// What takes minutes and only reads, at whatever file: nobody waits for it. Dropped at the end.
  void run_examination(std::function<void(const std::filesystem::path& folder)> task);
  /// After so many failures, one after another, of what is tried again for reasons of one map's own: twice as
  /// long each time, two minutes at most.
  [[nodiscard]] static std::chrono::seconds delay_after(int failures);
  /// Runs `task` on the writer's thread after a time; dropped at the end.
  void later(std::function<void()> task, std::chrono::milliseconds delay = kSaveDelay);

  /// Why nothing can be kept at present, for a person: the medium takes nothing (full, over quota, failing).
  /// Until a write succeeds, one of the store's own at the latest. Empty when all is well. What is wrong with
  /// one map's file is told to who writes it, and is no trouble of the store.
  [[nodiscard]] std::string trouble() const;

 private:
  struct Job {
    std::function<void(Store&)> task;  ///< or:
    MapId map;
    std::optional<MapHeader> creation;
    MapUpdate update;
    Done done;
  };
  struct Later {
    MonotonicTime due;
    std::function<void()> task;
  };
  MapPersistence(std::unique_ptr<Store> store, Runtime runtime, Logger log);
  void post(Job job);
  /// One turn of the writer; when the next is due.
  [[nodiscard]] std::optional<MonotonicTime> work();
  void carry_out(std::vector<Job> jobs);
  void write_group(std::vector<Job*> group);
  void finish(const Job& job, const Status& written);
  /// Runs `work`; what it throws (memory, a library) is an error like others.
  [[nodiscard]] Status guarded(const std::function<Status()>& work);
  void note(const Status& written);
  void probe_if_due();
  struct Loaded;
  [[nodiscard]] Loaded load(MapId map, const MapMakerOptions& options, RestoredImages images) const;
  [[nodiscard]] static Loaded make_ready(MapId map, Result<StoredMap> stored, const MapMakerOptions& options,
                                         RestoredImages images);
  [[nodiscard]] Result<RestoredMap> settle(Loaded loaded);
  /// Of a map that cannot be loaded and has been there: out of the way if it is damaged, else left alone.
  void part_with(const Loaded& failed);
  void forget_unloaded(MapId map);

  const std::unique_ptr<Store> store_;  ///< used by the writer only, once it runs, but for folders
  const std::filesystem::path folder_;
  const ServerId server_;
  const uint64_t start_count_;
  const std::vector<MapId> deleted_ids_;
  const std::vector<OverlapRecord> overlaps_;
  Logger log_;

  mutable std::mutex mutex_;  ///< of what follows
  std::vector<Job> jobs_;
  std::vector<Later> later_;  ///< in order of time
  std::string trouble_;
  std::vector<UnloadedMap> unloaded_;
  MonotonicTime probe_due_;  ///< while there is trouble

  const std::shared_ptr<const Clock> clock_;
  std::unique_ptr<Turns> writer_;
  std::shared_ptr<HeldLane> beside_;
  std::unique_ptr<Executor> examiner_;
};

}  // namespace cairn
