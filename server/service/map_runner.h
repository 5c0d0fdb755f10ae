// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/base/time.h"
#include "common/wire/messages.h"
#include "server/mapping/map_maker.h"
#include "server/service/clock.h"
#include "server/service/executor.h"
#include "server/service/map_persistence.h"
#include "server/service/offer_chain.h"
#include "server/service/pending_offers.h"
#include "server/service/strand.h"
#include "server/service/work_times.h"

namespace cairn {

/// Whose command a job is: kept with the decision on it.
struct JobOrigin {
  std::string client;  ///< name
  wire::CommandId command;
  uint64_t proposal = 0;    ///< not 0: it is this one of the map's, which goes when it is accepted
  Timestamp proposed = {};  ///< when that was kept aside, and its client answered
};

/// A seed as it came in: the images are decoded on the map's queue.
struct SeedJob {
  JobOrigin origin;
  SeedInput input;  ///< without images
  wire::ImageMessage first_image;
  wire::ImageMessage second_image;
  bool lockstep = false;
  std::shared_ptr<const PendingOffer> pending = {};  ///< nothing: it cannot be withdrawn
};

struct OfferJob {
  JobOrigin origin;
  KeyframeInput input;             ///< without image
  uint64_t reference_command = 0;  ///< not 0: its pose is relative to the frame of this earlier offer
  Epoch epoch;
  wire::ImageMessage image;
  bool lockstep = false;
  std::shared_ptr<const PendingOffer> pending = {};  ///< nothing: it cannot be withdrawn
};

/// Why nothing comes of a seed that was withdrawn.
inline constexpr const char* kSeedWithdrawn =
    "whether this client may make maps has changed while its map was being made";

/// A state of the map to be shown to others.
struct MapRevision {
  MapSnapshotPtr snapshot;
  MapStatistics statistics;
  std::vector<KeyframeView> views;
  IndexedMapPtr indexed = {};               ///< its part of the place index, where that is made already
  std::vector<MonotonicTime> offered = {};  ///< when the keyframes came that are in no revision before
};

/// The server's word on an offer, without its place in the client's stream.
struct OfferJudgement {
  wire::OfferDecision decision = wire::OfferDecision::kAccepted;
  std::string reason;
  KeyframeId keyframe;
  Revision revision;
};

/// Grey image of a message, or why not (size other than stated, not an image).
[[nodiscard]] Result<GrayImagePtr> decode_image(const wire::ImageMessage& message);

/// Measures of a map that take a look at all of it.
struct MapMeasures {
  double reprojection_rms = 0;  ///< as MapMaker::reprojection_rms()
  /// Cameras that took its keyframes, and how many each took.
  std::vector<std::pair<CameraParameters, size_t>> cameras;
};

/// One map at work: a MapMaker behind its serial queue. Offers come before upkeep (a running step yields to
/// them, also to those of other maps); global adjustments run on a copy in the other executor and are adopted
/// on the queue. With a store, what is accepted is answered when it is durable; the queue does not wait for
/// that. Callbacks are made on the queue, or by the store's writer. A lockstep job is answered only when the
/// work it causes, global adjustment included, is finished. With a store, a map that has nothing to do can
/// be idle: its images are evicted, and paged in before the next step of its work. Every job is answered,
/// whatever happens in it, unless stop() comes first. Thread-safe; tasks keep it alive.
class MapRunner : public std::enable_shared_from_this<MapRunner> {
 public:
  struct Executors {
    Executor& urgent;
    Executor& background;
  };
  struct Listener {
    std::function<void(MapRevision revision)> changed;
    /// Called when the map's work has failed, or its file: it is served as last published and takes nothing
    /// any more.
    std::function<void(std::string why)> frozen;
    /// Called when the map's images have been evicted, or paged in.
    std::function<void(MapStatistics now)> paged = {};
  };
  /// `snapshot` is null when the seed was refused.
  using SeedDone = std::function<void(Result<SeedResult> result, MapSnapshotPtr snapshot)>;
  using OfferDone = std::function<void(OfferJudgement judgement)>;

  /// `store` and `times` outlive the executors; null: nothing is kept, nothing is counted.
  MapRunner(Executors executors, const MapMakerOptions& options, MapPersistence* store, Listener listener,
            std::shared_ptr<const Clock> clock, Logger log, WorkTimes* times = nullptr);

  /// Makes the map, unless the seed is withdrawn meanwhile; to be called once, before anything else.
  void start(SeedJob job, SeedDone done);
  /// Takes up a map from the store, and returns its first revision. To be called once, before anything else.
  [[nodiscard]] MapRevision resume(RestoredMap restored);
  /// Goes on with the work that was due.
  void go_on();
  void offer(OfferJob job, OfferDone done);
  /// Ends upkeep as soon as possible; what waits is dropped without an answer: for the end. Does not wait.
  void stop() {
    stopping_ = true;
    queue_.close();
  }
  /// Ends the map's work as soon as possible since it has been deleted; what waits is answered with that.
  /// Does not wait.
  void retire();
  /// Called when what has changed, and all that was handed in before, is durable, or with why it is not.
  using Kept = std::function<void(const Status& kept)>;
  /// Another state of the map is about to take its place: as flush(). From then on it takes nothing and hands
  /// in nothing; offers are answered as stale.
  void give_way(Kept then);
  /// Goes on with the map, as nothing has taken its place.
  void go_on_after_all();
  /// Evicts the images when there is nothing to do or to keep and the map is as in revision `indexed`, whose
  /// images the place index has; else nothing happens. With a store only. Does not wait.
  void evict_images(std::pair<Epoch, Revision> indexed);
  /// Takes measures of the map as it is; `done` gets them on the queue.
  void measure(std::function<void(const MapMeasures&)> done);
  /// Publishes the map under another name once the store has it, then calls `done`; or with why it has not.
  void rename(std::string name, std::function<void(Status kept)> done);
  /// Hands what has changed to the store. `then` is called by the writer, or on the queue where nothing is
  /// handed in (any more). A map that is frozen stays as it was kept last.
  void flush(Kept then);
  /// Hands what has changed to the store. For the end, when no executor runs any more.
  void save_last_changes();

 private:
  static constexpr const char* kDeleted = "the map was deleted";
  /// The answer to offers when the map has gone or given way.
  [[nodiscard]] OfferJudgement ended() const;
  [[nodiscard]] bool has_ended() const { return deleted_ || replaced_; }
  [[nodiscard]] Result<SeedResult> make_map(SeedJob* job);
  [[nodiscard]] bool refer_to_earlier(OfferJob* job) const;
  [[nodiscard]] OfferJudgement judge(OfferJob job, MonotonicTime arrival);
  /// Runs MapMaker::step(), and counts its work.
  StepReport step(const std::function<bool()>& should_yield);
  /// Runs a piece of the map's work; an exception in it (memory, a library) freezes the map. Whether it came
  /// to its end.
  bool guarded(const std::function<void()>& work);
  void freeze(const std::string& why);
  void schedule_upkeep();
  void do_upkeep();
  void begin_global_adjustment();
  /// All work with its global adjustments, beside which no upkeep runs; then `then` is called.
  void finish_in_lockstep(std::function<void()> then);
  /// For lockstep: a step a task until nothing is left to do, global adjustments as tasks of their own. Then
  /// `then` is called, whether or not the work has failed.
  void finish_all_work(int adjustments, std::function<void()> then);
  void adjust_in_lockstep(int adjustments, std::function<void()> then);
  /// Solves in an executor and adopts on the queue, then calls `then` there.
  void adjust_globally(Executor* executor, std::function<void(bool adopted)> then);
  // Images evicted and paged in (map_paging.cpp).
  [[nodiscard]] bool may_evict(const std::pair<Epoch, Revision>& indexed) const;
  /// Whether the next step of the map's work needs images that have been evicted.
  [[nodiscard]] bool needs_images() const;
  /// Pages in evicted images, then calls `then` on the queue, whatever has happened: when they can never be
  /// had, the map is frozen. What may pass (a busy disk, no memory) is waited for. An exception: nothing has
  /// been done.
  void page_in(std::function<void()> then);
  using Continuations = std::shared_ptr<std::vector<std::function<void()>>>;
  using ImageRows = Result<std::vector<ImageRow>>;
  /// Runs a part of page_in(). True from `part`: another part is under way; else this was the last one.
  void read_on(const Continuations& waiting, const std::function<bool()>& part);
  [[nodiscard]] bool read_next_images(const Continuations& waiting);
  /// Pages in the images of rows[next] and later ones.
  [[nodiscard]] bool page_in_images(const std::shared_ptr<const ImageRows>& rows, size_t next,
                                    const Continuations& waiting);
  [[nodiscard]] bool try_later(const Continuations& waiting, const std::string& why);
  void end_reading(const Continuations& waiting);
  /// An offer of a chain, which waits until those before it are in the map.
  struct WaitingOffer {
    OfferJob job;
    MonotonicTime arrival;
    OfferDone done;
  };
  void take_next_of_chain();
  void decide(OfferJob job, MonotonicTime arrival, OfferDone done);
  void answer_offer(const JobOrigin& origin, OfferJudgement judgement, OfferDone done);
  void answer_seed(const SeedJob& job, Result<SeedResult> result, const SeedDone& done);
  void publish();

  // Into the store (map_keeping.cpp).
  void keep_seed(const SeedJob& job, const SeedResult& result, const SeedDone& done);
  void keep_offer(const JobOrigin& origin, const OfferJudgement& judgement, const OfferDone& done);
  /// Called on the writer's thread when what was handed in is not kept.
  void on_not_kept(const Error& error);
  void save_soon();
  void save();
  void hand_over(const Kept& then);
  /// Called by the writer when a save has ended.
  void on_saved(const Status& kept);
  [[nodiscard]] MapUpdate take_update();

  Executor& background_;
  Strand queue_;
  MapMakerOptions options_;
  MapPersistence* store_;
  std::shared_ptr<const Clock> clock_;
  Listener listener_;
  Logger log_;
  WorkTimes* times_;
  Executor& urgent_;
  std::atomic<bool> stopping_{false};
  std::atomic<bool> deleted_{false};
  std::atomic<bool> replaced_{false};
  std::atomic<int> waiting_offers_{0};
  OfferChain chain_;                      ///< used on the queue
  std::deque<WaitingOffer> chained_;      ///< used on the queue
  std::atomic<bool> update_lost_{false};  ///< the store lacks changes that were taken
  std::atomic<int> saves_failed_{0};      ///< one after another, for reasons of this map's own

  // What follows belongs to the queue.
  std::unique_ptr<MapMaker> maker_;
  MapSnapshotPtr published_;
  std::map<MapWork, std::chrono::nanoseconds> spent_;  ///< processor time of work that was interrupted
  std::map<KeyframeId, MonotonicTime> arrivals_;       ///< of offers whose points are not made yet
  std::vector<MonotonicTime> offered_;  ///< arrivals of those whose keyframes the next revision has
  std::vector<MonotonicTime> pointed_;  ///< arrivals of those whose points the next revision has
  bool upkeep_scheduled_ = false;
  int lockstep_jobs_ = 0;  ///< whose work is being finished
  bool adjusting_globally_ = false;
  bool save_scheduled_ = false;
  uint64_t changes_ = 0;                      ///< counts what is taken in, and what is handed to the store
  Continuations::weak_type awaiting_images_;  ///< held by what reads them back; expired: nothing does
  int reads_failed_ = 0;                      ///< one after another
  std::vector<DecisionRecord> refusals_;      ///< to be kept with the next save
  std::vector<EpochRecord> epochs_;           ///< of the map
  bool frozen_ = false;  ///< its work has failed: it is served as last published and takes no keyframes
};

}  // namespace cairn
