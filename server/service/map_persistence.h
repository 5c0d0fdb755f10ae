// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/base/log.h"
#include "server/mapping/map_maker.h"
#include "server/store/store.h"

namespace cairn {

/// A map that the store has given back, ready to go on.
struct RestoredMap {
  MapHeader header;  ///< its epoch is the one that has just begun
  std::unique_ptr<MapMaker> maker;
  bool plane_aligned = false;
  std::vector<EpochRecord> epochs;
  std::vector<DecisionRecord> decisions;
};

/// The store at work: one thread writes what the queues of all maps hand in. What has come while a
/// transaction was being committed goes into the next one of its map together (group commit), so a caller
/// waits for two commits at most, however many there are. Thread-safe.
class MapPersistence {
 public:
  /// Called by the writer when the update is durable, or with the reason why it is not.
  using Done = std::function<void(Status)>;
  /// Changes that no answer waits for are saved after this time at the latest (DESIGN 9: 5 s).
  static constexpr std::chrono::seconds kSaveDelay{2};

  /// Errors: as Store::open().
  [[nodiscard]] static Result<std::unique_ptr<MapPersistence>> start(const std::filesystem::path& folder,
                                                                     Logger log);
  /// Writes what waits, then ends.
  ~MapPersistence();
  MapPersistence(const MapPersistence&) = delete;
  MapPersistence& operator=(const MapPersistence&) = delete;

  [[nodiscard]] ServerId server() const { return server_; }
  [[nodiscard]] uint64_t start_count() const { return start_count_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

  /// All maps of the store, by `threads` threads, each under a new epoch. One that is damaged is set aside
  /// (logged with file, rows and where the copy is) and replaced by what could be saved of it, if anything.
  /// To be called once, before anything else.
  [[nodiscard]] std::vector<RestoredMap> restore(const MapMakerOptions& options, int threads);

  void create(MapHeader header, MapUpdate whole, Done done);
  void write(MapId map, MapUpdate update, Done done);
  /// Anything else to be done with the store, in its turn.
  void run(std::function<void(Store& store)> task);
  /// Runs `task` on the writer's thread after kSaveDelay; dropped at the end.
  void later(std::function<void()> task);

  /// Why nothing can be kept at present, for a person: the last write failed, a moment ago. Empty when all is
  /// well.
  [[nodiscard]] std::string trouble() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Job {
    std::function<void(Store&)> task;  ///< or:
    MapId map;
    std::optional<MapHeader> creation;
    MapUpdate update;
    Done done;
  };
  struct Later {
    Clock::time_point due;
    std::function<void()> task;
  };
  MapPersistence(std::unique_ptr<Store> store, Logger log);
  void post(Job job);
  void work();
  void carry_out(std::vector<Job> jobs);
  void write_group(std::vector<Job*> group);
  void note(const Status& written);

  const std::unique_ptr<Store> store_;  ///< used by the writer's thread only, once it runs
  const std::filesystem::path folder_;
  const ServerId server_;
  const uint64_t start_count_;
  Logger log_;

  mutable std::mutex mutex_;  ///< of what follows
  std::condition_variable wake_;
  std::vector<Job> jobs_;
  std::vector<Later> later_;  ///< in order of time
  std::string trouble_;
  Clock::time_point trouble_since_;
  bool stopping_ = false;

  std::thread thread_;
};

}  // namespace cairn
