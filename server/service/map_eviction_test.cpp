// SPDX-License-Identifier: Apache-2.0
// Idle maps: what they do afterwards is what they would have done, and only what is kept is evicted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/idle_map_fixture.h"

namespace cairn {
namespace {

using namespace cairn::testing;

TEST_F(IdleMapTest, AMapThatWasEvictedGoesOnAsOneThatWasNot) {
  const auto resident = start_map("resident");
  const auto idle = start_map("idle");
  for (const int step : {5, 8, 11}) {
    idle->evict();
    const size_t evicted = idle->newest().statistics.bytes;
    for (KeptMap* map : {resident.get(), idle.get()}) grow(map, step);
    EXPECT_EQ(idle->without_images(), 0U);
    EXPECT_LT(2 * evicted, idle->newest().statistics.bytes);
    EXPECT_TRUE(testing::bytes_of(*resident->newest().snapshot) ==
                testing::bytes_of(*idle->newest().snapshot));
  }
  idle->evict();
  for (KeptMap* map : {resident.get(), idle.get()}) map->end();
  EXPECT_TRUE(resident->content() == idle->content());
}

TEST_F(IdleMapTest, TwoMapsOfOneStoreAreEvictedAndPagedInTogether) {
  constexpr std::array<uint8_t, 2> kIds{1, 2};
  std::vector<std::unique_ptr<KeptMap>> resident;
  std::vector<std::unique_ptr<KeptMap>> idle;
  {
    const StorePtr store = open_store("idle");
    for (const uint8_t id : kIds) {
      resident.push_back(
          start_map("resident" + std::to_string(id), open_store("resident" + std::to_string(id)), {{id}}));
      idle.push_back(start_map("idle", store, {{id}}));
    }
  }
  grow(resident[1].get(), 5);  // they are not alike
  grow(idle[1].get(), 5);
  for (const int step : {8, 11}) {
    for (const auto& map : resident) grow(map.get(), step);
    for (const auto& map : idle) map->evict();
    std::vector<std::future<OfferJudgement>> offers;
    for (const auto& map : idle) offers.push_back(map->send(frame(*map, step)));
    for (auto& offer : offers) EXPECT_EQ(value_of(std::move(offer)).decision, wire::OfferDecision::kAccepted);
  }
  for (const auto& maps : {std::cref(resident), std::cref(idle)})
    for (const auto& map : maps.get()) map->end();
  for (size_t i = 0; i < kIds.size(); ++i) EXPECT_TRUE(resident[i]->content() == idle[i]->content());
}

TEST_F(IdleMapTest, WhatNeedsNoImagesDoesNotPageThemIn) {
  const auto map = start_map();
  map->evict();
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

TEST_F(IdleMapTest, IsFoundAndPosesAreAsBefore) {
  const auto map = start_map();
  grow(map.get(), 5);
  grow(map.get(), 8);
  WorkerPool queries(1, 0, null_logger());
  const auto runner =
      std::make_shared<RelocalizationRunner>(RelocalizationRunner::Executors{urgent_, queries, background_},
                                             RelocOptions{}, std::make_shared<SystemClock>(), null_logger());
  const auto report = [&] {
    MapRevision now = map->newest();
    runner->report(now.snapshot, std::move(now.views), std::move(now.indexed));
  };
  const auto image = scene_.view(6);
  const auto ask = [&] {
    return answer_to<RelocalizationAnswer>(
        [&](auto done) { runner->ask(query(scene_.camera(), *image), std::move(done)); });
  };
  report();
  const RelocalizationAnswer resident = ask();
  ASSERT_TRUE(has_place(resident.verdict)) << resident.reason;
  map->evict();
  ASSERT_TRUE(answer_to<Status>([&](auto done) { map->runner().rename("bench", done); }));
  report();  // a revision without images
  const auto expect_found = [&] {
    const RelocalizationAnswer evicted = ask();
    ASSERT_TRUE(has_place(evicted.verdict)) << evicted.reason;
    const PlaceCandidate& best = evicted.candidates.front();
    EXPECT_EQ(best.map, map->id());
    EXPECT_EQ(best.keyframe, resident.candidates.front().keyframe);
    EXPECT_GT(2 * best.inliers, resident.candidates.front().inliers);
    EXPECT_EQ(runner->index()->find(map->id())->snapshot, map->newest().snapshot);
  };
  expect_found();
  runner->remove(map->id());
  EXPECT_FALSE(has_place(ask().verdict));
  map->evict();
  map->restart();  // and indexed from what the file says
  EXPECT_EQ(map->without_images(), 4U);
  report();
  expect_found();
  queries.stop();
}

TEST_F(IdleMapTest, OnlyWhatIsDoneKeptAndIndexedIsEvicted) {
  const auto map = start_map();
  map->evict();
  grow(map.get(), 5);
  map->flush();
  const Epoch epoch = map->newest().snapshot->epoch;
  map->runner().evict_images({epoch, Revision{1}});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what it is now has not been indexed";
  map->runner().evict_images({Epoch{epoch.value + 1}, map->newest().snapshot->revision});
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "what has the same number in another epoch is not this";

  const Revision next{map->newest().snapshot->revision.value + 1};
  {
    const auto blocked = block_urgent_executor();
    map->runner().rename("bench", [](const Status&) {});
    map->runner().evict_images({epoch, next});
  }
  map->settle();
  EXPECT_EQ(map->newest().snapshot->revision, next);
  EXPECT_EQ(map->without_images(), 0U) << "its name is not kept yet";

  std::future<OfferJudgement> offered;
  {
    const auto blocked = block_urgent_executor();
    offered = map->send(frame(*map, 8), false);
    map->runner().evict_images({epoch, Revision{next.value + 1}});
  }
  EXPECT_EQ(value_of(std::move(offered)).decision, wire::OfferDecision::kAccepted);
  map->settle();
  EXPECT_EQ(map->without_images(), 0U) << "there is work to do";
}

TEST_F(IdleMapTest, NothingIsEvictedBeforeTheWriterHasComeToIt) {
  const auto map = start_map();
  map->flush();
  const auto writer = map->block_writer();
  map->ask_to_evict();
  map->settle_queue();
  EXPECT_EQ(map->without_images(), 0U);
  writer->release();
  map->evict();
}

TEST_F(IdleMapTest, WhatComesBetweenTheTwoLooksPutsItOff) {
  const auto map = start_map();
  map->flush();
  const auto writer = map->block_writer();
  map->ask_to_evict();
  EXPECT_EQ(map->offer(frame(*map, testing::kSecondStep)).decision, wire::OfferDecision::kTooClose);
  map->flush();  // a decision that may or may not be kept
  writer->release();
  map->settle();
  EXPECT_EQ(map->without_images(), 0U);
  map->evict();
}

/// An accepted keyframe's images may be in no file yet, for all that has been handed in.
class FailingWriterTest : public IdleMapTest {
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
  /// The writer goes on and fails: the offer is refused, no image is evicted, and all is kept in the end.
  void expect_refused_and_kept() {
    map_->ask_to_evict();
    map_->settle_queue();
    writer_->release();
    EXPECT_EQ(value_of(std::move(offered_)).decision, wire::OfferDecision::kFull);
    map_->settle();
    expect_kept();
  }

 private:
  void expect_kept() {
    EXPECT_EQ(map_->without_images(), 0U);
    EXPECT_EQ(map_->frozen(), "");
    map_->damage("ALTER TABLE gone RENAME TO images");
    map_->evict();
    const MapSnapshotPtr before = map_->newest().snapshot;
    map_->restart();
    EXPECT_EQ(map_->newest().statistics.keyframes, 3U);
    EXPECT_EQ(map_->newest().snapshot->point_count(), before->point_count());
    grow(map_.get(), 8);
    map_->end();
    EXPECT_FALSE(map_->content().empty());
  }
  std::unique_ptr<Blocker> writer_;
  std::future<OfferJudgement> offered_;

 protected:
  std::unique_ptr<KeptMap> map_;
};

TEST_F(FailingWriterTest, WhatCouldNotBeKeptIsNotEvicted) {
  hand_in_in_vain();
  expect_refused_and_kept();
}

TEST_F(FailingWriterTest, NorIsWhatIsHandedInAgainAndMayFailAgain) {
  hand_in_in_vain();
  // Between the failure and the second look: all is handed in once more.
  map_->store().run([this](Store&) { map_->runner().flush([](const Status&) {}); });
  expect_refused_and_kept();
}

}  // namespace
}  // namespace cairn
