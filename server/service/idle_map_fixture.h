// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <future>
#include <mutex>
#include <new>
#include <stdexcept>

#include "common/image/corners.h"
#include "common/image/place.h"
#include "server/service/map_runner.h"
#include "server/service/relocalization_runner.h"
#include "server/service/store_threads.h"
#include "server/service/system_clock.h"
#include "server/service/worker_pool.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/rows.h"

/// Tests only: a map at work that is kept in a store, and whose images may be evicted.
namespace cairn::testing {

inline constexpr std::chrono::seconds kDeadline{60};
inline constexpr int kPngEndBytes = 12;

template <typename Value>
Value value_of(std::future<Value> future) {
  if (future.wait_for(kDeadline) != std::future_status::ready) throw std::runtime_error("no answer");
  return future.get();
}

/// Waits for the value that `ask` passes to the callback that it is given, and returns it.
template <typename Value>
Value answer_to(const std::function<void(std::function<void(Value)>)>& ask) {
  auto promise = std::make_shared<std::promise<Value>>();
  auto future = promise->get_future();
  ask([promise](Value value) { promise->set_value(std::move(value)); });
  return value_of(std::move(future));
}

inline wire::ImageMessage raw(const GrayImage& image) {
  wire::ImageMessage message;
  message.width = static_cast<uint32_t>(image.width());
  message.height = static_cast<uint32_t>(image.height());
  for (int y = 0; y < image.height(); ++y)
    message.bytes.insert(message.bytes.end(), image.row(y), image.row(y) + image.width());
  return message;
}

/// The query that a tracker would send of a view of the scene: where was it taken?
inline RelocalizationQuery query(const CameraPtr& camera, const GrayImage& image) {
  Pyramid pyramid;
  pyramid.build(image.view());
  return {camera, describe_place(pyramid, detect_corners(pyramid)), {}, true};
}

/// Blocks an executor: the task that it submits ends when the blocker goes, or at release().
class Blocker {
 public:
  using Submit = std::function<void(std::function<void()> task)>;
  explicit Blocker(const Submit& submit) {
    submit([released = released_] { released->get_future().wait(); });
  }
  ~Blocker() { release(); }
  Blocker(const Blocker&) = delete;
  Blocker& operator=(const Blocker&) = delete;
  void release() {
    if (!std::exchange(is_released_, true)) released_->set_value();
  }

 private:
  std::shared_ptr<std::promise<void>> released_ = std::make_shared<std::promise<void>>();
  bool is_released_ = false;
};

using StorePtr = std::shared_ptr<MapPersistence>;

/// A map at work that is kept in a store.
class KeptMap {
 public:
  KeptMap(MapRunner::Executors executors, std::filesystem::path folder, StorePtr store)
      : executors_(executors), folder_(std::move(folder)), store_(std::move(store)) {
    make_runner();
  }
  ~KeptMap() { end_work(); }
  KeptMap(const KeptMap&) = delete;
  KeptMap& operator=(const KeptMap&) = delete;

  [[nodiscard]] MapRunner& runner() { return *runner_; }
  [[nodiscard]] MapPersistence& store() { return *store_; }
  [[nodiscard]] MapId id() const { return newest().snapshot->map; }
  [[nodiscard]] MapRevision newest() const {
    const std::scoped_lock lock(mutex_);
    return newest_;
  }
  [[nodiscard]] size_t without_images() const { return newest().statistics.without_images; }
  [[nodiscard]] std::string frozen() const {
    const std::scoped_lock lock(mutex_);
    return frozen_;
  }
  /// Called whenever images have been evicted or paged in.
  void on_paged(std::function<void()> listener) {
    set([&] { on_paged_ = std::move(listener); });
  }

  [[nodiscard]] Result<SeedResult> start(const SeedInput& input) {
    SeedJob job;
    job.origin = next_origin();
    job.input = input;
    job.first_image = raw(*input.first_image);
    job.second_image = raw(*input.second_image);
    job.lockstep = true;
    using Answer = Result<SeedResult>;
    return answer_to<Answer>([&](std::function<void(Answer)> done) {
      runner_->start(std::move(job),
                     [done](Answer result, const MapSnapshotPtr&) { done(std::move(result)); });
    });
  }
  [[nodiscard]] OfferJob job(const KeyframeInput& input, bool lockstep = true) {
    OfferJob job;
    job.origin = next_origin();
    job.input = input;
    job.epoch = newest().snapshot->epoch;
    job.image = raw(*input.image);
    job.lockstep = lockstep;
    return job;
  }
  std::future<OfferJudgement> send(const KeyframeInput& input, bool lockstep = true) {
    auto promise = std::make_shared<std::promise<OfferJudgement>>();
    runner_->offer(job(input, lockstep),
                   [promise](OfferJudgement judged) { promise->set_value(std::move(judged)); });
    return promise->get_future();
  }
  OfferJudgement offer(const KeyframeInput& input) { return value_of(send(input)); }

  /// Waits until what was begun on the queue, and what that has posted to it, has come to its end.
  void settle_queue() {
    for (int i = 0; i < 3; ++i) (void)answer_to<MapMeasures>([this](auto done) { runner_->measure(done); });
  }
  /// Waits until the writer has done what was handed to it.
  void settle_writer() {
    (void)answer_to<bool>([this](auto done) { store_->run([done](Store&) { done(true); }); });
  }
  void settle() {
    for (int i = 0; i < 2; ++i) {
      settle_queue();
      settle_writer();
    }
    settle_queue();
  }
  /// Hands in what has changed; the writer may be blocked.
  void flush() {
    runner_->flush([](const Status&) {});
    settle_queue();
  }
  [[nodiscard]] std::unique_ptr<Blocker> block_writer() {
    return std::make_unique<Blocker>([this](auto task) { store_->run([task](Store&) { task(); }); });
  }
  void ask_to_evict() { runner_->evict_images({newest().snapshot->epoch, newest().snapshot->revision}); }
  /// Waits until all is kept and all images are evicted. It asks again, as a server does: a save whose time
  /// comes between the two looks is a reason to wait.
  void evict() {
    const auto is_done = [this] { return without_images() == newest().statistics.keyframes; };
    const auto deadline = std::chrono::steady_clock::now() + kDeadline;
    do {
      flush();
      ask_to_evict();
      settle();
    } while (!is_done() && std::chrono::steady_clock::now() < deadline);
    EXPECT_TRUE(is_done()) << without_images() << " of " << newest().statistics.keyframes;
  }

  /// Damages the map's file, as another program or the disk may.
  void damage(const std::string& sql) const {
    const Status done = open_file().execute(sql);
    ASSERT_TRUE(done) << done.error().message;
  }
  /// Makes the rows of all images so large, without another image in them.
  void inflate_images(size_t bytes) const {
    auto database = open_file();
    for (int64_t id = 1; id <= static_cast<int64_t>(newest().statistics.keyframes); ++id) {
      auto select = database.prepare("SELECT data FROM images WHERE id = ?");
      ASSERT_TRUE(select && *select->bind(0, id).step());
      const auto blob = select->blob(0);
      std::vector<uint8_t> data(blob.begin(), blob.end());
      const std::vector<uint8_t> end(data.end() - kPngEndBytes, data.end());
      data.resize(bytes);
      std::copy(end.begin(), end.end(), data.end() - kPngEndBytes);
      auto put = database.prepare(put_row_sql("images"));
      ASSERT_TRUE(put);
      ASSERT_TRUE(put->bind(0, id).bind(1, data).bind(2, row_checksum(id, data)).run());
    }
  }
  [[nodiscard]] std::filesystem::path file() const {
    return folder_ / "maps" / (to_hex(id().bytes) + ".cairnmap");
  }

  /// Ends the map and restores it, as a server does that ends and starts again. Precondition: it has a store
  /// of its own.
  void restart() {
    end_work();
    runner_->save_last_changes();
    store_.reset();
    store_ = std::move(*MapPersistence::start(folder_, store_threads(null_logger()), null_logger()));
    std::vector<RestoredMap> restored =
        store_->opening().restore({}, on_threads(1), RestoredImages::kEvicted);
    ASSERT_EQ(restored.size(), 1U);
    make_runner();
    MapRevision first = runner_->resume(std::move(restored[0]));
    set([&] { newest_ = std::move(first); });
    runner_->go_on();
  }
  /// Ends the map: its last changes are kept, and the store is let go.
  void end() {
    end_work();
    runner_->save_last_changes();
    store_.reset();
  }
  /// The map that comes back from its file, whole. When everybody has let go of the store. Not the rows as
  /// they lie there: what a removed point was made of is among them if a save came before its removal, and is
  /// left out by whoever reads them.
  [[nodiscard]] std::vector<uint8_t> content() const {
    auto opened = MapFile::open(file());
    if (!opened) throw std::runtime_error(opened.error().message);
    const StoredMap stored = opened->load();
    EXPECT_THAT(stored.damage, ::testing::IsEmpty());
    const MapHeader& header = stored.header;
    auto restored =
        MapMaker::restore(stored.record, {header.id, header.name, header.epoch}, MapMakerOptions{});
    if (!restored) throw std::runtime_error(restored.error().message);
    EXPECT_THAT(restored->repairs, ::testing::IsEmpty());
    return testing::bytes_of(restored->maker->take_changes());
  }

 private:
  void make_runner() {
    runner_ = std::make_shared<MapRunner>(
        executors_, MapMakerOptions{}, store_.get(),
        MapRunner::Listener{[this](MapRevision now) { set([&] { newest_ = std::move(now); }); },
                            [this](const std::string& why) { set([&] { frozen_ = why; }); },
                            [this](const MapStatistics& now) {
                              std::function<void()> listener;
                              set([&] {
                                newest_.statistics = now;
                                listener = on_paged_;
                              });
                              if (listener) listener();
                            }},
        std::make_shared<SystemClock>(), null_logger());
  }
  /// No task of it runs any more, or will.
  void end_work() {
    runner_->stop();
    for (Executor* executor : {&executors_.background, &executors_.urgent, &executors_.background})
      (void)answer_to<bool>([executor](auto done) { executor->submit([done] { done(true); }); });
  }
  [[nodiscard]] sqlite::Database open_file() const {
    auto database = sqlite::Database::open(file(), sqlite::OpenMode::kReadWrite);
    if (!database) throw std::runtime_error(database.error().message);
    return std::move(*database);
  }
  [[nodiscard]] JobOrigin next_origin() { return {"anna", {SessionId{1}, ++commands_}}; }
  template <typename Set>
  void set(Set change) {
    const std::scoped_lock lock(mutex_);
    change();
  }
  const MapRunner::Executors executors_;
  const std::filesystem::path folder_;
  uint64_t commands_ = 0;
  mutable std::mutex mutex_;
  MapRevision newest_;
  std::string frozen_;
  std::function<void()> on_paged_;
  StorePtr store_;
  std::shared_ptr<MapRunner> runner_;
};

class IdleMapTest : public testing::KeptMapFixture {
 protected:
  ~IdleMapTest() override {
    urgent_.stop();
    background_.stop();
  }
  [[nodiscard]] StorePtr open_store(const std::string& name) const {
    return std::move(*MapPersistence::start(folder_ / name, store_threads(null_logger()), null_logger()));
  }
  [[nodiscard]] std::unique_ptr<KeptMap> start_map(const std::string& store_name, StorePtr store, MapId id) {
    auto map = std::make_unique<KeptMap>(executors(), folder_ / store_name, std::move(store));
    input_.map = id;
    const auto made = map->start(input_);
    EXPECT_TRUE(made) << made.error().message;
    return map;
  }
  /// Starts a map with a store of its own.
  [[nodiscard]] std::unique_ptr<KeptMap> start_map(const std::string& name = "map") {
    return start_map(name, open_store(name), header_.id);
  }
  [[nodiscard]] KeyframeInput frame(const KeptMap& map, int step) const {
    return testing::make_offer(scene_, *map.newest().snapshot, step);
  }
  void grow(KeptMap* map, int step) {
    const OfferJudgement judged = map->offer(frame(*map, step));
    EXPECT_EQ(judged.decision, wire::OfferDecision::kAccepted) << judged.reason;
  }
  [[nodiscard]] MapRunner::Executors executors() { return {urgent_, background_}; }
  [[nodiscard]] std::unique_ptr<Blocker> block_urgent_executor() {
    return std::make_unique<Blocker>([this](auto task) { urgent_.submit(task); });  // its only worker
  }
  WorkerPool urgent_{1, 0, null_logger()};
  WorkerPool background_{1, 0, null_logger()};
};

}  // namespace cairn::testing
