// SPDX-License-Identifier: Apache-2.0
// Maps that rest: what they do afterwards is what they would have done, and what is lost meanwhile is said.
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
#include "server/service/place_desk.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/rows.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::chrono::seconds kDeadline{60};
constexpr int kPngEndBytes = 12;

template <typename Value>
Value value_of(std::future<Value> future) {
  if (future.wait_for(kDeadline) != std::future_status::ready) throw std::runtime_error("no answer");
  return future.get();
}

/// What `ask` passes on to the callback that it is given.
template <typename Value>
Value answer_to(const std::function<void(std::function<void(Value)>)>& ask) {
  auto promise = std::make_shared<std::promise<Value>>();
  auto future = promise->get_future();
  ask([promise](Value value) { promise->set_value(std::move(value)); });
  return value_of(std::move(future));
}

wire::ImageMessage raw(const GrayImage& image) {
  wire::ImageMessage message;
  message.width = static_cast<uint32_t>(image.width());
  message.height = static_cast<uint32_t>(image.height());
  for (int y = 0; y < image.height(); ++y)
    message.bytes.insert(message.bytes.end(), image.row(y), image.row(y) + image.width());
  return message;
}

/// Where a view of the scene was taken, by what a tracker would send of it.
PlaceQuery question(const CameraPtr& camera, const GrayImage& image) {
  constexpr std::array<int, kPyramidLevels> kFastThresholds = {10, 15, 15, 10};
  Pyramid pyramid;
  pyramid.build(image.view());
  std::array<CornerList, kPyramidLevels> corners;
  for (int l = 0; l < kPyramidLevels; ++l) {
    const auto i = static_cast<size_t>(l);
    detect_fast10(pyramid.level(l), kFastThresholds[i], &corners[i]);
  }
  return {camera, describe_place(pyramid, corners), {}, true};
}

/// What is begun on a lane stays there until this goes, or release().
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
  KeptMap(MapRunner::Lanes lanes, std::filesystem::path folder, StorePtr store)
      : lanes_(lanes), folder_(std::move(folder)), store_(std::move(store)) {
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
  /// Called whenever images have been let go or are back.
  void on_rested(std::function<void()> listener) {
    set([&] { on_rested_ = std::move(listener); });
  }

  Result<SeedResult> start(const SeedInput& input) {
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

  /// What was begun on the queue, and what that has posted to it, has come to its end.
  void settle_queue() {
    for (int i = 0; i < 3; ++i) (void)answer_to<double>([this](auto done) { runner_->measure(done); });
  }
  /// So has what was handed to the writer.
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
  void flush() {
    (void)answer_to<bool>([this](auto done) { runner_->flush([done] { done(true); }); });
  }
  [[nodiscard]] std::unique_ptr<Blocker> block_writer() {
    return std::make_unique<Blocker>([this](auto task) { store_->run([task](Store&) { task(); }); });
  }
  void ask_to_rest() { runner_->rest(newest().snapshot->revision); }
  /// All kept, and then all images let go.
  void rest() {
    flush();
    ask_to_rest();
    settle();
    EXPECT_EQ(without_images(), newest().statistics.keyframes);
  }

  /// By another program, or by the disk.
  void damage(const std::string& sql) const {
    const Status done = open_file().execute(sql);
    ASSERT_TRUE(done) << done.error().message;
  }
  /// Makes the rows of all images so large, without another picture in them.
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

  /// As by a server that ends and starts again. With a store of its own.
  void restart() {
    runner_->save_last_changes();
    end_work();
    store_.reset();
    store_ = std::move(*MapPersistence::start(folder_, null_logger()));
    std::vector<RestoredMap> restored = store_->restore({}, 1, RestoredImages::kLetGo);
    ASSERT_EQ(restored.size(), 1U);
    make_runner();
    MapRevision first = runner_->resume(std::move(restored[0]));
    set([&] { newest_ = std::move(first); });
    runner_->go_on();
  }
  /// It keeps its last changes and lets go of the store.
  void end() {
    runner_->save_last_changes();
    end_work();
    store_.reset();
  }
  /// All that its file holds. When everybody has let go of the store.
  [[nodiscard]] std::vector<uint8_t> content() const {
    auto opened = MapFile::open(file());
    if (!opened) throw std::runtime_error(opened.error().message);
    const StoredMap map = opened->load();
    EXPECT_THAT(map.damage, IsEmpty());
    return testing::bytes_of(map.record);
  }

 private:
  void make_runner() {
    runner_ = std::make_shared<MapRunner>(
        lanes_, MapMakerOptions{}, store_.get(),
        MapRunner::Listener{[this](MapRevision now) { set([&] { newest_ = std::move(now); }); },
                            [this](const std::string& why) { set([&] { frozen_ = why; }); },
                            [this](const MapStatistics& now) {
                              std::function<void()> listener;
                              set([&] {
                                newest_.statistics = now;
                                listener = on_rested_;
                              });
                              if (listener) listener();
                            }},
        null_logger());
  }
  /// No task of it runs any more, or will.
  void end_work() {
    runner_->stop();
    for (WorkerPool* lane : {&lanes_.background, &lanes_.urgent, &lanes_.background})
      (void)answer_to<bool>([lane](auto done) { lane->submit([done] { done(true); }); });
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
  const MapRunner::Lanes lanes_;
  const std::filesystem::path folder_;
  uint64_t commands_ = 0;
  mutable std::mutex mutex_;
  MapRevision newest_;
  std::string frozen_;
  std::function<void()> on_rested_;
  StorePtr store_;
  std::shared_ptr<MapRunner> runner_;
};

class MapRestingTest : public testing::KeptMapFixture {
 protected:
  ~MapRestingTest() override {
    urgent_.stop();
    background_.stop();
  }
  [[nodiscard]] StorePtr open_store(const std::string& name) const {
    return std::move(*MapPersistence::start(folder_ / name, null_logger()));
  }
  [[nodiscard]] std::unique_ptr<KeptMap> start_map(const std::string& store_name, StorePtr store, MapId id) {
    auto map = std::make_unique<KeptMap>(lanes(), folder_ / store_name, std::move(store));
    input_.map = id;
    const auto made = map->start(input_);
    EXPECT_TRUE(made) << made.error().message;
    return map;
  }
  /// With a store of its own.
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
  [[nodiscard]] MapRunner::Lanes lanes() { return {urgent_, background_}; }
  [[nodiscard]] std::unique_ptr<Blocker> block_urgent_lane() {
    return std::make_unique<Blocker>([this](auto task) { urgent_.submit(task); });  // its only worker
  }
  WorkerPool urgent_{1, 0, null_logger()};
  WorkerPool background_{1, 0, null_logger()};
};

TEST_F(MapRestingTest, AMapThatHasRestedGoesOnAsOneThatHasNot) {
  const auto awake = start_map("awake");
  const auto rested = start_map("rested");
  for (const int step : {5, 8, 11}) {
    rested->rest();
    const size_t at_rest = rested->newest().statistics.bytes;
    for (KeptMap* map : {awake.get(), rested.get()}) grow(map, step);
    EXPECT_EQ(rested->without_images(), 0U);
    EXPECT_LT(2 * at_rest, rested->newest().statistics.bytes);
    EXPECT_TRUE(testing::bytes_of(*awake->newest().snapshot) ==
                testing::bytes_of(*rested->newest().snapshot));
  }
  rested->rest();
  for (KeptMap* map : {awake.get(), rested.get()}) map->end();
  EXPECT_TRUE(awake->content() == rested->content());
}

TEST_F(MapRestingTest, TwoMapsOfOneStoreRestAndWakeTogether) {
  constexpr std::array<uint8_t, 2> kIds{1, 2};
  std::vector<std::unique_ptr<KeptMap>> awake;
  std::vector<std::unique_ptr<KeptMap>> rested;
  {
    const StorePtr store = open_store("rested");
    for (const uint8_t id : kIds) {
      awake.push_back(
          start_map("awake" + std::to_string(id), open_store("awake" + std::to_string(id)), {{id}}));
      rested.push_back(start_map("rested", store, {{id}}));
    }
  }
  grow(awake[1].get(), 5);  // they are not alike
  grow(rested[1].get(), 5);
  for (const int step : {8, 11}) {
    for (const auto& map : awake) grow(map.get(), step);
    for (const auto& map : rested) map->rest();
    std::vector<std::future<OfferJudgement>> offers;
    for (const auto& map : rested) offers.push_back(map->send(frame(*map, step)));
    for (auto& offer : offers) EXPECT_EQ(value_of(std::move(offer)).decision, wire::OfferDecision::kAccepted);
  }
  for (const auto& maps : {std::cref(awake), std::cref(rested)})
    for (const auto& map : maps.get()) map->end();
  for (size_t i = 0; i < kIds.size(); ++i) EXPECT_TRUE(awake[i]->content() == rested[i]->content());
}

TEST_F(MapRestingTest, WhatNeedsNoImagesDoesNotWakeIt) {
  const auto map = start_map();
  map->rest();
  EXPECT_EQ(map->offer(frame(*map, testing::kSecondStep)).decision, wire::OfferDecision::kTooClose);
  EXPECT_TRUE(answer_to<Status>([&](auto done) { map->runner().rename("bench", done); }));
  EXPECT_EQ(map->newest().snapshot->name, "bench");
  EXPECT_LT(answer_to<double>([&](auto done) { map->runner().measure(done); }), 0.6);
  map->runner().go_on();
  map->settle();
  EXPECT_EQ(map->without_images(), 2U);
  EXPECT_EQ(map->newest().views.size(), 2U) << "it stays in the index";
  map->restart();
  map->settle();
  EXPECT_EQ(map->without_images(), 2U);
}

TEST_F(MapRestingTest, IsFoundAndPosesAreAsBefore) {
  const auto map = start_map();
  grow(map.get(), 5);
  grow(map.get(), 8);
  WorkerPool questions(1, 0, null_logger());
  const auto desk = std::make_shared<PlaceDesk>(PlaceDesk::Lanes{urgent_, questions, background_},
                                                RelocOptions{}, null_logger());
  const auto report = [&] {
    MapRevision now = map->newest();
    desk->report(now.snapshot, std::move(now.views), std::move(now.indexed));
  };
  const auto image = scene_.render(testing::Scene::pose(6), 6);
  const auto ask = [&] {
    return answer_to<PlaceAnswer>(
        [&](auto done) { desk->ask(question(scene_.camera(), *image), std::move(done)); });
  };
  report();
  const PlaceAnswer awake = ask();
  ASSERT_TRUE(has_place(awake.verdict)) << awake.reason;
  map->rest();
  ASSERT_TRUE(answer_to<Status>([&](auto done) { map->runner().rename("bench", done); }));
  report();  // a revision without pictures
  const auto expect_found = [&] {
    const PlaceAnswer at_rest = ask();
    ASSERT_TRUE(has_place(at_rest.verdict)) << at_rest.reason;
    const PlaceCandidate& best = at_rest.candidates.front();
    EXPECT_EQ(best.map, map->id());
    EXPECT_EQ(best.keyframe, awake.candidates.front().keyframe);
    EXPECT_GT(2 * best.inliers, awake.candidates.front().inliers);
    EXPECT_EQ(desk->index()->find(map->id())->snapshot, map->newest().snapshot);
  };
  expect_found();
  desk->remove(map->id());
  EXPECT_FALSE(has_place(ask().verdict));
  map->rest();
  map->restart();  // and indexed from what the file says
  EXPECT_EQ(map->without_images(), 4U);
  report();
  expect_found();
  questions.stop();
}

TEST_F(MapRestingTest, OnlyWhatIsDoneKeptAndIndexedIsLetGo) {
  const auto map = start_map();
  map->rest();
  grow(map.get(), 5);
  map->flush();
  map->runner().rest(Revision{1});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what it is now has not been indexed";

  const Revision next{map->newest().snapshot->revision.value + 1};
  {
    const auto blocked = block_urgent_lane();
    map->runner().rename("bench", [](const Status&) {});
    map->runner().rest(next);
  }
  map->settle();
  EXPECT_EQ(map->newest().snapshot->revision, next);
  EXPECT_EQ(map->without_images(), 0U) << "its name is not kept yet";

  std::future<OfferJudgement> offered;
  {
    const auto blocked = block_urgent_lane();
    offered = map->send(frame(*map, 8), false);
    map->runner().rest(Revision{next.value + 1});
  }
  EXPECT_EQ(value_of(std::move(offered)).decision, wire::OfferDecision::kAccepted);
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "there is work to do";
}

TEST_F(MapRestingTest, NothingIsLetGoBeforeTheWriterHasComeToIt) {
  const auto map = start_map();
  map->flush();
  const auto writer = map->block_writer();
  map->ask_to_rest();
  map->settle_queue();
  EXPECT_EQ(map->without_images(), 0U);
  writer->release();
  map->settle();
  EXPECT_EQ(map->without_images(), 2U);
}

TEST_F(MapRestingTest, WhatComesBetweenTheTwoLooksPutsItOff) {
  const auto map = start_map();
  map->flush();
  const auto writer = map->block_writer();
  map->ask_to_rest();
  EXPECT_EQ(map->offer(frame(*map, testing::kSecondStep)).decision, wire::OfferDecision::kTooClose);
  map->flush();  // a decision that may or may not be kept
  writer->release();
  map->settle();
  EXPECT_EQ(map->without_images(), 0U);
  map->rest();
}

/// An accepted keyframe's images may be in no file yet, for all that has been handed in.
class FailingWriterTest : public MapRestingTest {
 protected:
  /// A map whose writer is blocked, with a keyframe handed to it that cannot be written.
  void hand_in_in_vain() {
    map_ = start_map();
    map_->flush();
    map_->settle();
    writer_ = map_->block_writer();
    offered_ = map_->send(frame(*map_, 5));
    while (map_->newest().statistics.keyframes < 3) map_->settle_queue();
    map_->flush();
    map_->damage("ALTER TABLE images RENAME TO gone");
  }
  /// All is kept in the end.
  void expect_kept() {
    EXPECT_EQ(map_->without_images(), 0U);
    EXPECT_EQ(map_->frozen(), "");
    map_->damage("ALTER TABLE gone RENAME TO images");
    map_->rest();
    const MapSnapshotPtr before = map_->newest().snapshot;
    map_->restart();
    EXPECT_EQ(map_->newest().statistics.keyframes, 3U);
    EXPECT_EQ(map_->newest().snapshot->point_count(), before->point_count());
    grow(map_.get(), 8);
    map_->end();
    EXPECT_FALSE(map_->content().empty());
  }
  std::unique_ptr<KeptMap> map_;
  std::unique_ptr<Blocker> writer_;
  std::future<OfferJudgement> offered_;
};

TEST_F(FailingWriterTest, WhatCouldNotBeKeptIsNotLetGo) {
  hand_in_in_vain();
  map_->ask_to_rest();
  map_->settle_queue();
  writer_->release();
  EXPECT_EQ(value_of(std::move(offered_)).decision, wire::OfferDecision::kFull);
  map_->settle();
  expect_kept();
}

TEST_F(FailingWriterTest, NorIsWhatIsHandedInAgainAndMayFailAgain) {
  hand_in_in_vain();
  // Between the failure and the second look: all is handed in once more.
  map_->store().run([this](Store&) { map_->runner().flush([] {}); });
  map_->ask_to_rest();
  map_->settle_queue();
  writer_->release();
  EXPECT_EQ(value_of(std::move(offered_)).decision, wire::OfferDecision::kFull);
  map_->settle();
  expect_kept();
}

TEST_F(MapRestingTest, ReadingBackHoldsUpNoOtherMap) {
  const auto resting = start_map("resting");
  const auto other = start_map("other");
  resting->rest();
  const auto slow_disk = resting->block_writer();
  auto waiting = resting->send(frame(*resting, 5));
  for (const int step : {5, 8}) grow(other.get(), step);  // by the only worker
  EXPECT_EQ(waiting.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  slow_disk->release();
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(resting->without_images(), 0U);
}

/// Rows of which two fill a turn of the writer.
class LargeImagesTest : public MapRestingTest {
 protected:
  [[nodiscard]] std::unique_ptr<KeptMap> start_large_map() {
    auto map = start_map();
    for (const int step : {5, 8}) grow(map.get(), step);
    map->rest();
    map->inflate_images(MapPersistence::kReadPerTurn / 2);
    return map;
  }
};

TEST_F(LargeImagesTest, TheWriterReadsSoManyBytesInOneTurn) {
  const auto map = start_large_map();
  auto writer = map->block_writer();
  auto waiting = map->send(frame(*map, 11));
  map->settle_queue();  // the first turn is asked for
  const auto queue = block_urgent_lane();
  writer->release();
  map->settle_writer();
  map->damage("DELETE FROM images WHERE id = 3");
  queue->release();
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kDamaged);
  EXPECT_THAT(map->frozen(), HasSubstr("row 3 is missing"));
}

TEST_F(LargeImagesTest, AllComeBackInSeveralTurns) {
  const auto map = start_large_map();
  auto waiting = map->send(frame(*map, 11));
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(map->without_images(), 0U);
  EXPECT_EQ(map->newest().statistics.keyframes, 5U);
}

TEST_F(MapRestingTest, ImagesCountBeforeTheyAreRead) {
  const auto map = start_map();
  grow(map.get(), 5);
  const MapStatistics awake = map->newest().statistics;
  EXPECT_EQ(awake.bytes_let_go, 0U);
  map->rest();
  const MapStatistics at_rest = map->newest().statistics;
  const size_t images = awake.bytes - at_rest.bytes;
  EXPECT_GT(2 * at_rest.bytes_let_go, images);
  EXPECT_LT(at_rest.bytes_let_go, 2 * images);

  const auto slow_disk = map->block_writer();
  const auto waiting = map->send(frame(*map, 8), false);
  map->settle_queue();
  const MapStatistics waking = map->newest().statistics;
  EXPECT_EQ(waking.without_images, 3U);
  EXPECT_EQ(waking.bytes_let_go, 0U);
  EXPECT_GT(waking.bytes, at_rest.bytes + at_rest.bytes_let_go);
}

TEST_F(MapRestingTest, AJobWhoseAnswerFailsTakesNobodyWithIt) {
  const auto map = start_map();
  map->rest();
  const auto slow_disk = map->block_writer();
  const auto said = std::make_shared<std::promise<void>>();
  map->runner().offer(map->job(frame(*map, 5)), [said](const OfferJudgement&) {
    said->set_value();
    throw std::runtime_error("cannot be told");
  });
  auto next = map->send(frame(*map, 8));
  map->settle_queue();
  slow_disk->release();
  ASSERT_EQ(said->get_future().wait_for(kDeadline), std::future_status::ready);
  EXPECT_EQ(value_of(std::move(next)).decision, wire::OfferDecision::kAccepted);
  grow(map.get(), 11);
}

TEST_F(MapRestingTest, ADiskThatDoesNotAnswerIsAskedAgain) {
  const auto awake = start_map("awake");
  const auto map = start_map();
  map->rest();
  map->restart();  // its file is not open
  const std::filesystem::path aside = folder_ / "aside";
  std::filesystem::rename(map->file(), aside);
  std::filesystem::create_directory(map->file());  // there, and cannot be opened
  auto waiting = map->send(frame(*map, 5));
  for (int i = 0; i < 3; ++i) map->settle();
  EXPECT_EQ(map->frozen(), "");
  EXPECT_EQ(waiting.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  std::filesystem::remove(map->file());
  std::filesystem::rename(aside, map->file());
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(map->without_images(), 0U);
  grow(awake.get(), 5);
  EXPECT_TRUE(testing::bytes_of(*awake->newest().snapshot) == testing::bytes_of(*map->newest().snapshot));
}

TEST_F(MapRestingTest, ShortageOfMemoryIsWaitedFor) {
  const auto map = start_map();
  map->rest();
  map->on_rested([&] {
    map->on_rested({});
    throw std::bad_alloc();
  });
  grow(map.get(), 5);
  EXPECT_EQ(map->frozen(), "");
  EXPECT_EQ(map->without_images(), 0U);
}

void expect_deleted(std::future<OfferJudgement> waiting) {
  const OfferJudgement judged = value_of(std::move(waiting));
  EXPECT_EQ(judged.decision, wire::OfferDecision::kUnknownMap);
  EXPECT_THAT(judged.reason, HasSubstr("deleted"));
}

TEST_F(MapRestingTest, AMapThatIsDeletedBeforeItsImagesAreReadAnswers) {
  const auto map = start_map();
  map->rest();
  const auto writer = map->block_writer();
  map->store().run([id = map->id()](Store& store) { EXPECT_TRUE(store.remove(id)); });
  auto waiting = map->send(frame(*map, 5));
  map->settle_queue();
  map->runner().retire();
  expect_deleted(std::move(waiting));  // whatever the disk does
  writer->release();
  map->settle();
  EXPECT_EQ(map->frozen(), "");
  EXPECT_FALSE(std::filesystem::exists(map->file()));
}

TEST_F(MapRestingTest, AMapThatIsDeletedWhileItsImagesComeBackAnswers) {
  const auto map = start_map();
  map->rest();
  auto writer = map->block_writer();
  auto waiting = map->send(frame(*map, 5));
  map->settle_queue();
  const auto queue = block_urgent_lane();
  writer->release();
  map->settle_writer();  // they have been read
  map->runner().retire();
  map->store().run([id = map->id()](Store& store) { EXPECT_TRUE(store.remove(id)); });
  map->settle_writer();
  queue->release();
  expect_deleted(std::move(waiting));
  map->settle();
  EXPECT_EQ(map->frozen(), "");
  EXPECT_FALSE(std::filesystem::exists(map->file()));
}

TEST_F(MapRestingTest, AMapThatIsDeletedWhileItsDiskDoesNotAnswerAnswers) {
  const auto map = start_map();
  map->rest();
  map->on_rested([] { throw std::bad_alloc(); });
  auto waiting = map->send(frame(*map, 5));
  for (int i = 0; i < 3; ++i) map->settle();
  const auto writer = map->block_writer();  // it asks for no second try
  map->runner().retire();
  expect_deleted(std::move(waiting));
}

struct Loss {
  const char* name;
  const char* sql;
  const char* said;
};

class LostImageTest : public MapRestingTest, public ::testing::WithParamInterface<Loss> {};

TEST_P(LostImageTest, FreezesTheMapAsItWasPublished) {
  const auto map = start_map();
  grow(map.get(), 5);
  map->rest();
  const MapSnapshotPtr before = map->newest().snapshot;
  map->damage(GetParam().sql);
  for (const int step : {8, 11}) {
    const OfferJudgement judged = map->offer(frame(*map, step));
    EXPECT_EQ(judged.decision, wire::OfferDecision::kDamaged);
    EXPECT_EQ(judged.revision, before->revision);
  }
  EXPECT_THAT(map->frozen(), HasSubstr("pictures cannot be read back"));
  EXPECT_THAT(map->frozen(), HasSubstr(GetParam().said));
  EXPECT_EQ(map->newest().snapshot, before);
}

INSTANTIATE_TEST_SUITE_P(
    EachWay, LostImageTest,
    ::testing::Values(Loss{"Checksum", "UPDATE images SET checksum = checksum + 1 WHERE id = 2",
                           "table images, row 2: the checksum is wrong"},
                      Loss{"Missing", "DELETE FROM images WHERE id = 2", "table images, row 2 is missing"},
                      Loss{"Table", "DROP TABLE images", "no such table: images"}),
    [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace cairn
