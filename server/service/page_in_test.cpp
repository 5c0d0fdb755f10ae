// SPDX-License-Identifier: Apache-2.0
// Images of an idle map are paged in: beside other work, in turns, and what is lost is said.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/idle_map_fixture.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using namespace cairn::testing;

using PageInTest = IdleMapTest;

TEST_F(PageInTest, ReadingBackHoldsUpNoOtherMap) {
  const auto idle = start_map("idle");
  const auto other = start_map("other");
  idle->evict();
  const auto slow_disk = idle->block_writer();
  auto waiting = idle->send(frame(*idle, 5));
  for (const int step : {5, 8}) grow(other.get(), step);  // by the only worker
  EXPECT_EQ(waiting.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  slow_disk->release();
  EXPECT_EQ(value_of(std::move(waiting)).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(idle->without_images(), 0U);
}

/// Rows of which two fill a turn of the writer.
class LargeImagesTest : public IdleMapTest {
 protected:
  [[nodiscard]] std::unique_ptr<KeptMap> start_large_map() {
    auto map = start_map();
    for (const int step : {5, 8}) grow(map.get(), step);
    map->evict();
    map->inflate_images(MapPersistence::kReadPerTurn / 2);
    return map;
  }
};

TEST_F(LargeImagesTest, TheWriterReadsSoManyBytesInOneTurn) {
  const auto map = start_large_map();
  auto writer = map->block_writer();
  auto waiting = map->send(frame(*map, 11));
  map->settle_queue();  // the first turn is asked for
  const auto queue = block_urgent_executor();
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

TEST_F(PageInTest, ImagesCountBeforeTheyAreRead) {
  const auto map = start_map();
  grow(map.get(), 5);
  const MapStatistics resident = map->newest().statistics;
  EXPECT_EQ(resident.evicted_bytes, 0U);
  map->evict();
  const MapStatistics evicted = map->newest().statistics;
  const size_t images = resident.bytes - evicted.bytes;
  EXPECT_GT(2 * evicted.evicted_bytes, images);
  EXPECT_LT(evicted.evicted_bytes, 2 * images);

  const auto slow_disk = map->block_writer();
  const auto waiting = map->send(frame(*map, 8), false);
  map->settle_queue();
  const MapStatistics paging = map->newest().statistics;
  EXPECT_EQ(paging.without_images, 3U);
  EXPECT_EQ(paging.evicted_bytes, 0U);
  EXPECT_GT(paging.bytes, evicted.bytes + evicted.evicted_bytes);
}

TEST_F(PageInTest, AJobWhoseAnswerFailsTakesNobodyWithIt) {
  const auto map = start_map();
  map->evict();
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

TEST_F(PageInTest, ADiskThatDoesNotAnswerIsAskedAgain) {
  const auto resident = start_map("resident");
  const auto map = start_map();
  map->evict();
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
  grow(resident.get(), 5);
  EXPECT_TRUE(testing::bytes_of(*resident->newest().snapshot) == testing::bytes_of(*map->newest().snapshot));
}

TEST_F(PageInTest, ShortageOfMemoryIsWaitedFor) {
  const auto map = start_map();
  map->evict();
  map->on_paged([&] {
    map->on_paged({});
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

TEST_F(PageInTest, AMapThatIsDeletedBeforeItsImagesAreReadAnswers) {
  const auto map = start_map();
  map->evict();
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

TEST_F(PageInTest, AMapThatIsDeletedWhileItsImagesComeBackAnswers) {
  const auto map = start_map();
  map->evict();
  auto writer = map->block_writer();
  auto waiting = map->send(frame(*map, 5));
  map->settle_queue();
  const auto queue = block_urgent_executor();
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

TEST_F(PageInTest, AMapThatIsDeletedWhileItsDiskDoesNotAnswerAnswers) {
  const auto map = start_map();
  map->evict();
  map->on_paged([] { throw std::bad_alloc(); });
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

class LostImageTest : public IdleMapTest, public ::testing::WithParamInterface<Loss> {};

TEST_P(LostImageTest, FreezesTheMapAsItWasPublished) {
  const auto map = start_map();
  grow(map.get(), 5);
  map->evict();
  const MapSnapshotPtr before = map->newest().snapshot;
  map->damage(GetParam().sql);
  for (const int step : {8, 11}) {
    const OfferJudgement judged = map->offer(frame(*map, step));
    EXPECT_EQ(judged.decision, wire::OfferDecision::kDamaged);
    EXPECT_EQ(judged.revision, before->revision);
  }
  EXPECT_THAT(map->frozen(), HasSubstr("images cannot be read back"));
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
