// SPDX-License-Identifier: Apache-2.0
// Maps that rest: what they do afterwards is what they would have done, and what is lost meanwhile is said.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <future>
#include <mutex>

#include "server/service/map_runner.h"
#include "server/store/kept_map_fixture.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::chrono::seconds kDeadline{60};

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

/// A map at work, with a store of its own.
class KeptMap {
 public:
  KeptMap(MapRunner::Lanes lanes, const std::filesystem::path& folder)
      : folder_(folder), store_(std::move(*MapPersistence::start(folder, null_logger()))) {
    runner_ = std::make_shared<MapRunner>(
        lanes, MapMakerOptions{}, store_.get(),
        MapRunner::Listener{[this](MapRevision now) { set([&] { newest_ = std::move(now); }); },
                            [this](const std::string& why) { set([&] { frozen_ = why; }); },
                            [this](const MapStatistics& now) { set([&] { newest_.statistics = now; }); }},
        null_logger());
  }
  ~KeptMap() { runner_->stop(); }
  KeptMap(const KeptMap&) = delete;
  KeptMap& operator=(const KeptMap&) = delete;

  [[nodiscard]] MapRunner& runner() { return *runner_; }
  [[nodiscard]] MapPersistence& store() { return *store_; }
  [[nodiscard]] MapRevision newest() const {
    const std::scoped_lock lock(mutex_);
    return newest_;
  }
  [[nodiscard]] size_t without_images() const { return newest().statistics.without_images; }
  [[nodiscard]] std::string frozen() const {
    const std::scoped_lock lock(mutex_);
    return frozen_;
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
  std::future<OfferJudgement> send(const KeyframeInput& input, bool lockstep = true) {
    OfferJob job;
    job.origin = next_origin();
    job.input = input;
    job.epoch = newest().snapshot->epoch;
    job.image = raw(*input.image);
    job.lockstep = lockstep;
    auto promise = std::make_shared<std::promise<OfferJudgement>>();
    runner_->offer(std::move(job), [promise](OfferJudgement j) { promise->set_value(std::move(j)); });
    return promise->get_future();
  }
  OfferJudgement offer(const KeyframeInput& input) { return value_of(send(input)); }
  /// What was begun on the queue and by the writer before has come to its end.
  void settle() {
    for (int i = 0; i < 2; ++i) {
      (void)answer_to<double>([this](auto done) { runner_->measure(done); });
      (void)answer_to<bool>([this](auto done) { store_->run([done](Store&) { done(true); }); });
    }
    (void)answer_to<double>([this](auto done) { runner_->measure(done); });
  }
  void ask_to_rest() {
    runner_->rest(newest().snapshot->revision);
    settle();
  }
  /// All kept, and then all images let go.
  void rest() {
    (void)answer_to<bool>([this](auto done) { runner_->flush([done] { done(true); }); });
    ask_to_rest();
    EXPECT_EQ(without_images(), newest().statistics.keyframes);
  }
  void damage(const std::string& sql) {
    auto database = sqlite::Database::open(file(), sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database);
    const Status done = database->execute(sql);
    ASSERT_TRUE(done) << done.error().message;
  }
  [[nodiscard]] std::filesystem::path file() const {
    return folder_ / "maps" / (to_hex(newest().snapshot->map.bytes) + ".cairnmap");
  }
  /// All that the file holds. For the end.
  [[nodiscard]] std::vector<uint8_t> end() {
    const std::filesystem::path path = file();
    runner_->save_last_changes();
    store_.reset();
    auto opened = MapFile::open(path);
    if (!opened) throw std::runtime_error(opened.error().message);
    const StoredMap map = opened->load();
    EXPECT_THAT(map.damage, IsEmpty());
    return testing::bytes_of(map.record);
  }

 private:
  [[nodiscard]] JobOrigin next_origin() { return {"anna", {SessionId{1}, ++commands_}}; }
  template <typename Set>
  void set(Set change) {
    const std::scoped_lock lock(mutex_);
    change();
  }
  const std::filesystem::path folder_;
  uint64_t commands_ = 0;
  mutable std::mutex mutex_;
  MapRevision newest_;
  std::string frozen_;
  std::unique_ptr<MapPersistence> store_;
  std::shared_ptr<MapRunner> runner_;
};

class MapRestingTest : public testing::KeptMapFixture {
 protected:
  ~MapRestingTest() override {
    urgent_.stop();
    background_.stop();
  }
  [[nodiscard]] std::unique_ptr<KeptMap> start_map(const std::string& name) {
    auto map = std::make_unique<KeptMap>(MapRunner::Lanes{urgent_, background_}, folder_ / name);
    input_.map = header_.id;
    const auto made = map->start(input_);
    EXPECT_TRUE(made) << made.error().message;
    return map;
  }
  [[nodiscard]] KeyframeInput frame(const KeptMap& map, int step) const {
    return testing::make_offer(scene_, *map.newest().snapshot, step);
  }
  /// Nothing comes between what `post` puts into a queue.
  void at_once(const std::function<void()>& post) {
    const auto release = std::make_shared<std::promise<void>>();
    urgent_.submit([release] { release->get_future().wait(); });  // its only worker
    post();
    release->set_value();
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
    for (KeptMap* map : {awake.get(), rested.get()}) {
      const OfferJudgement judged = map->offer(frame(*map, step));
      EXPECT_EQ(judged.decision, wire::OfferDecision::kAccepted) << judged.reason;
    }
    EXPECT_EQ(rested->without_images(), 0U);
    EXPECT_LT(2 * at_rest, rested->newest().statistics.bytes);
    EXPECT_TRUE(testing::bytes_of(*awake->newest().snapshot) ==
                testing::bytes_of(*rested->newest().snapshot));
  }
  rested->rest();
  EXPECT_TRUE(awake->end() == rested->end());
}

TEST_F(MapRestingTest, WhatNeedsNoImagesDoesNotWakeIt) {
  const auto map = start_map("map");
  map->rest();
  EXPECT_EQ(map->offer(frame(*map, testing::kSecondStep)).decision, wire::OfferDecision::kTooClose);
  EXPECT_TRUE(answer_to<Status>([&](auto done) { map->runner().rename("bench", done); }));
  EXPECT_EQ(map->newest().snapshot->name, "bench");
  EXPECT_LT(answer_to<double>([&](auto done) { map->runner().measure(done); }), 0.6);
  map->settle();
  EXPECT_EQ(map->without_images(), 2U);
  EXPECT_EQ(map->newest().views.size(), 2U) << "it stays in the index";
}

TEST_F(MapRestingTest, OnlyWhatIsDoneKeptAndIndexedIsLetGo) {
  const auto map = start_map("map");
  map->rest();
  (void)map->offer(frame(*map, 5));
  (void)answer_to<bool>([&](auto done) { map->runner().flush([done] { done(true); }); });
  map->runner().rest(Revision{1});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what it is now has not been indexed";

  const Revision next{map->newest().snapshot->revision.value + 1};
  at_once([&] {
    map->runner().rename("bench", [](const Status&) {});
    map->runner().rest(next);
  });
  map->settle();
  EXPECT_EQ(map->newest().snapshot->revision, next);
  EXPECT_EQ(map->without_images(), 0U) << "its name is not kept yet";

  std::future<OfferJudgement> offered;
  at_once([&] {
    offered = map->send(frame(*map, 8), false);
    map->runner().rest(Revision{next.value + 1});
  });
  EXPECT_EQ(value_of(std::move(offered)).decision, wire::OfferDecision::kAccepted);
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "there is work to do";
}

TEST_F(MapRestingTest, ReadingBackHoldsUpNoOtherMap) {
  const auto resting = start_map("resting");
  const auto other = start_map("other");
  resting->rest();
  std::promise<void> release;
  resting->store().run([&](Store&) { release.get_future().wait(); });  // a slow disk
  auto waiting = resting->send(frame(*resting, 5));
  for (const int step : {5, 8}) {
    const OfferJudgement judged = other->offer(frame(*other, step));  // by the only worker
    EXPECT_EQ(judged.decision, wire::OfferDecision::kAccepted) << judged.reason;
  }
  EXPECT_EQ(waiting.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  release.set_value();
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(resting->without_images(), 0U);
}

TEST_F(MapRestingTest, AMapThatIsDeletedWhileItIsReadBackAnswers) {
  const auto map = start_map("map");
  map->rest();
  std::promise<void> release;
  map->store().run([&](Store&) { release.get_future().wait(); });
  auto waiting = map->send(frame(*map, 5));
  (void)answer_to<double>([&](auto done) { map->runner().measure(done); });  // the offer is at work
  map->runner().retire();
  release.set_value();
  (void)value_of(std::move(waiting));
  EXPECT_EQ(map->frozen(), "");
}

struct Loss {
  const char* name;
  const char* sql;
  const char* said;
};

class LostImageTest : public MapRestingTest, public ::testing::WithParamInterface<Loss> {};

TEST_P(LostImageTest, FreezesTheMapAsItWasPublished) {
  const auto map = start_map("map");
  ASSERT_EQ(map->offer(frame(*map, 5)).decision, wire::OfferDecision::kAccepted);
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
