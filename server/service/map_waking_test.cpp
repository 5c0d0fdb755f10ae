// SPDX-License-Identifier: Apache-2.0
// Images of a map that has rested are read back: beside other work, in turns, and what is lost is said.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/resting_map_fixture.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using namespace cairn::testing;

using ReadingBackTest = MapRestingTest;

TEST_F(ReadingBackTest, ReadingBackHoldsUpNoOtherMap) {
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

TEST_F(ReadingBackTest, ImagesCountBeforeTheyAreRead) {
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

TEST_F(ReadingBackTest, AJobWhoseAnswerFailsTakesNobodyWithIt) {
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

TEST_F(ReadingBackTest, ADiskThatDoesNotAnswerIsAskedAgain) {
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

TEST_F(ReadingBackTest, ShortageOfMemoryIsWaitedFor) {
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

TEST_F(ReadingBackTest, AMapThatIsDeletedBeforeItsImagesAreReadAnswers) {
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

TEST_F(ReadingBackTest, AMapThatIsDeletedWhileItsImagesComeBackAnswers) {
  const auto map = start_map();
  map->rest();
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

TEST_F(ReadingBackTest, AMapThatIsDeletedWhileItsDiskDoesNotAnswerAnswers) {
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
