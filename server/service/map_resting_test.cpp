// SPDX-License-Identifier: Apache-2.0
// Maps that rest: what they do afterwards is what they would have done, and only what is kept is let go.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/resting_map_fixture.h"

namespace cairn {
namespace {

using namespace cairn::testing;

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
  EXPECT_LT(answer_to<MapMeasures>([&](auto done) { map->runner().measure(done); }).reprojection_rms, 0.6);
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
  const auto desk =
      std::make_shared<PlaceDesk>(PlaceDesk::Executors{urgent_, questions, background_}, RelocOptions{},
                                  std::make_shared<SystemClock>(), null_logger());
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
  report();  // a revision without images
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
  const Epoch epoch = map->newest().snapshot->epoch;
  map->runner().rest({epoch, Revision{1}});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what it is now has not been indexed";
  map->runner().rest({Epoch{epoch.value + 1}, map->newest().snapshot->revision});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what has the same number in another epoch is not this";

  const Revision next{map->newest().snapshot->revision.value + 1};
  {
    const auto blocked = block_urgent_executor();
    map->runner().rename("bench", [](const Status&) {});
    map->runner().rest({epoch, next});
  }
  map->settle();
  EXPECT_EQ(map->newest().snapshot->revision, next);
  EXPECT_EQ(map->without_images(), 0U) << "its name is not kept yet";

  std::future<OfferJudgement> offered;
  {
    const auto blocked = block_urgent_executor();
    offered = map->send(frame(*map, 8), false);
    map->runner().rest({epoch, Revision{next.value + 1}});
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
  map->rest();
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
  map_->store().run([this](Store&) { map_->runner().flush([](const Status&) {}); });
  map_->ask_to_rest();
  map_->settle_queue();
  writer_->release();
  EXPECT_EQ(value_of(std::move(offered_)).decision, wire::OfferDecision::kFull);
  map_->settle();
  expect_kept();
}

}  // namespace
}  // namespace cairn
