// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/service/clock.h"
#include "server/service/executor.h"
#include "server/service/held_strand.h"
#include "server/service/map_opening.h"
#include "server/store/store.h"

namespace cairn {

/// What a store says when it is opened.
struct StoreAtStart {
  ServerId server;
  uint64_t start_count = 0;
  std::vector<MapId> deleted_ids;  ///< of maps that had been deleted: they are not given again
  std::vector<OverlapRecord> overlaps;
};

/// The store at work: one writer writes what the queues of all maps hand in. What has come of a map while
/// others were being written goes into its next transaction together (group commit): a caller waits for two
/// commits of each map that has something to write, at most, however many updates there are. Whole files are
/// read and written by another executor beside it. Thread-safe.
class MapPersistence {
 public:
  /// Called by the writer when the update is durable, or with the reason why it is not.
  using Done = std::function<void(Status)>;
  /// Changes that no answer waits for are handed in after this time. While nothing can be kept, the store is
  /// tested as often.
  static constexpr std::chrono::seconds kSaveDelay{2};
  static constexpr size_t kReadPerTurn = size_t{4} << 20;  ///< [bytes] by read_images(), and one row beyond

  /// Clock, writer and executors that the persistence works with. The clock is that of the writer's turns.
  struct Runtime {
    std::shared_ptr<const Clock> clock;
    std::unique_ptr<Turns> writer;
    std::unique_ptr<Executor> strand;    ///< one task at a time
    std::unique_ptr<Executor> examiner;  ///< likewise
  };
  /// Errors: as Store::open().
  [[nodiscard]] static Result<std::unique_ptr<MapPersistence>> start(const std::filesystem::path& folder,
                                                                     Runtime runtime, Logger log);
  /// Writes what waits, then ends.
  ~MapPersistence();
  MapPersistence(const MapPersistence&) = delete;
  MapPersistence& operator=(const MapPersistence&) = delete;

  [[nodiscard]] const StoreAtStart& at_start() const { return at_start_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// Maps that come from it.
  [[nodiscard]] MapOpening& opening() { return opening_; }
  [[nodiscard]] const MapOpening& opening() const { return opening_; }

  /// Images that have been evicted: the first of these keyframes' (Store::read_images()), as many as others
  /// that have something to write can wait for: no longer than a commit takes. `done` is called by the
  /// writer, in its turn: with all that was handed in before, whatever happens. Error kIo: it may be over
  /// soon.
  using ImagesRead = std::function<void(Result<std::vector<ImageRow>> rows)>;
  void read_images(MapId map, std::vector<KeyframeId> keyframes, ImagesRead done);

  void create(MapHeader header, MapUpdate whole, Done done);
  void write(MapId map, MapUpdate update, Done done);
  /// Anything else to be done with the store, in its turn. A task that throws is logged and ends alone.
  void run(std::function<void(Store& store)> task);
  /// Runs a task that takes seconds and leaves open maps alone (archives, deleted maps), beside the writer.
  /// Such tasks run one after another, while maps are being written. Dropped at the end.
  void run_on_strand(std::function<void(Store& store)> task);
  /// Calls `then` on the strand's thread, behind all tasks that wait there. Nothing else begins there while
  /// its `place` lives. Returns at once. For work for which a map is stopped: the map goes on until `then` is
  /// called.
  void hold_strand(std::function<void(HeldStrand::Hold place)> then);
  /// Runs a task that takes minutes and only reads, at whatever file: nobody waits for it. Dropped at the
  /// end.
  void run_examination(std::function<void(const std::filesystem::path& folder)> task);
  /// Delay before the next attempt at what failed for reasons of one map's own, after so many failures in a
  /// row: twice as long each time, two minutes at most.
  [[nodiscard]] static std::chrono::seconds delay_after(int failures);
  /// Runs `task` on the writer's thread after a time; dropped at the end.
  void later(std::function<void()> task, std::chrono::milliseconds delay = kSaveDelay);

  /// Why nothing can be kept at present, for a person: the medium takes nothing (full, over quota, failing).
  /// Until a write succeeds, one of the store's own at the latest. Empty when all is well. What is wrong with
  /// one map's file is told to who writes it, and is no trouble of the store.
  [[nodiscard]] std::string trouble() const;

 private:
  struct Job {
    std::function<void(Store&)> task = {};  ///< or:
    MapId map = {};
    std::optional<MapHeader> creation = {};
    MapUpdate update = {};
    Done done = {};
    std::shared_ptr<const Status> outcome = {};  ///< of what was written
    bool is_over = false;                        ///< it was carried out, and its outcome told
  };
  struct Later {
    MonotonicTime due;
    std::function<void()> task;
  };
  MapPersistence(std::unique_ptr<Store> store, Runtime runtime, Logger log);
  void post(Job job);
  /// Takes one turn of the writer. Returns when the next is due.
  [[nodiscard]] std::optional<MonotonicTime> work();
  void run_due(MonotonicTime now);
  void carry_out();
  void write_group(MapId map, std::span<Job> jobs);
  void finish(Job& job);
  void note(const Status& written);
  void probe_if_due();
  const std::unique_ptr<Store> store_;  ///< used by the writer only, once it runs, but for folders
  const std::filesystem::path folder_;
  const StoreAtStart at_start_;
  Logger log_;

  mutable std::mutex mutex_;  ///< of what follows
  std::vector<Job> jobs_;     ///< that no turn has taken yet
  std::vector<Later> later_;  ///< in order of time
  std::string trouble_;
  MonotonicTime probe_due_;  ///< while there is trouble

  std::vector<Job> batch_;  ///< of the writer: a turn that fails leaves the rest to the next

  const std::shared_ptr<const Clock> clock_;
  std::unique_ptr<Turns> writer_;
  std::shared_ptr<HeldStrand> strand_;
  std::unique_ptr<Executor> examiner_;
  MapOpening opening_;
};

}  // namespace cairn
