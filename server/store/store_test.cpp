// SPDX-License-Identifier: Apache-2.0
#include "server/store/store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <vector>

#include "server/store/store_fixture.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

using StoreTest = testing::StoreFixture;

TEST_F(StoreTest, IsTheSameServerAndLaterAtEveryStart) {
  uint64_t last = 0;
  ServerId server;
  for (int i = 0; i < 3; ++i) {
    const auto store = open();
    EXPECT_GT(store->start_count(), last);
    last = store->start_count();
    EXPECT_TRUE(store->server());
    EXPECT_TRUE(i == 0 || store->server() == server);
    server = store->server();
  }
}

TEST_F(StoreTest, BelongsToOneServerAtATime) {
  const auto first = open();
  const auto second = Store::open(folder_, null_logger());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kRefused);
  EXPECT_THAT(second.error().message, HasSubstr(folder_.string()));
}

TEST_F(StoreTest, MapsComeBackUnderLaterEpochs) {
  std::vector<uint8_t> kept;
  {
    const auto store = open();
    keep(store.get());
    ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
    const MapUpdate update = take_update();
    ASSERT_TRUE(store->write(header_.id, {&update, 1}));
    EXPECT_EQ(store->create(header_, {}).error().code, ErrorCode::kRefused);
  }
  Epoch last = header_.epoch;
  for (int i = 0; i < 3; ++i) {
    const auto store = open();
    EXPECT_THAT(store->maps(), ElementsAre(header_.id));
    const auto map = store->load(header_.id);
    ASSERT_TRUE(map) << map.error().message;
    EXPECT_GT(map->header.epoch, last);
    last = map->header.epoch;
    EXPECT_EQ(map->epochs.size(), static_cast<size_t>(i) + 2);
    EXPECT_TRUE(bytes_of(map->record) == bytes_of(whole()));
  }
}

TEST_F(StoreTest, DeletedMapsCanBeHadBack) {
  const auto store = open();
  keep(store.get());
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->remove(header_.id)) << "idempotent";
  EXPECT_THAT(store->maps(), IsEmpty());
  ASSERT_EQ(store->deleted_maps().size(), 1U);
  EXPECT_EQ(store->deleted_maps()[0].header.name, "desk");
  EXPECT_THAT(store->deleted_ids(), ElementsAre(header_.id));
  EXPECT_EQ(store->create(header_, {}).error().code, ErrorCode::kRefused) << "its id is not given again";
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->undelete(header_.id));
  EXPECT_THAT(store->maps(), ElementsAre(header_.id));
  EXPECT_TRUE(store->load(header_.id));
  EXPECT_EQ(store->remove(MapId{{9}}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(store->undelete(MapId{{9}}).error().code, ErrorCode::kNotFound);
  ASSERT_TRUE(store->remove(header_.id));
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->purge(header_.id));
  EXPECT_THAT(store->deleted_ids(), IsEmpty());
}

TEST_F(StoreTest, TheMapDeletedLastIsNamedFirst) {
  const auto store = open();
  start();
  const MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3}) {
    header_.id = MapId{{id}};
    ASSERT_TRUE(store->create(header_, whole));
  }
  for (const uint8_t id : {2, 3, 1}) ASSERT_TRUE(store->remove(MapId{{id}}));
  const auto deleted = store->deleted_maps();
  ASSERT_EQ(deleted.size(), 3U);
  EXPECT_EQ(deleted[0].header.id, MapId{{1}});
  EXPECT_EQ(deleted[2].header.id, MapId{{2}});
  EXPECT_GT(deleted[0].bytes, 0U);
}

TEST_F(StoreTest, OfDeletedMapsTheFirstAndTheLastDecisionsAreTold) {
  const auto store = open();
  start();
  MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3}) {
    header_.id = MapId{{id}};
    whole.decisions.clear();
    for (uint64_t seq = 1; seq <= 4 * id; ++seq) whole.decisions.push_back(decision(100 * id + seq));
    ASSERT_TRUE(store->create(header_, whole));
  }
  for (const uint8_t id : {2, 3, 1}) ASSERT_TRUE(store->remove(MapId{{id}}));
  const auto told = store->decisions_on_deleted(2, 3);
  ASSERT_THAT(told, SizeIs(2));
  const auto numbers = [](const DeletedDecisions& map) {
    std::vector<uint64_t> all;
    for (const DecisionRecord& d : map.decisions) all.push_back(d.seq);
    return all;
  };
  EXPECT_EQ(told[0].header.id, MapId{{1}}) << "deleted last";
  EXPECT_THAT(numbers(told[0]), ElementsAre(101, 102, 103, 104)) << "all that there are";
  EXPECT_EQ(told[1].header.id, MapId{{3}});
  EXPECT_THAT(numbers(told[1]), ElementsAre(301, 310, 311, 312));
}

TEST_F(StoreTest, ADeletedMapWithADamagedFileIsListedAndCanBePurged) {
  const auto store = open();
  start();
  const MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3, 4}) {
    header_.id = MapId{{id}};
    ASSERT_TRUE(store->create(header_, whole));
    ASSERT_TRUE(store->remove(header_.id));
  }
  const auto file = [this](uint8_t id) {
    return folder_ / "deleted" / (to_hex(MapId{{id}}.bytes) + ".cairnmap");
  };
  ASSERT_TRUE(sqlite::Database::open(file(1), sqlite::OpenMode::kReadWrite)
                  ->execute("UPDATE map SET checksum = checksum + 1 WHERE id = 1"));
  std::filesystem::resize_file(file(2), 0);
  std::filesystem::copy_file(file(4), file(3), std::filesystem::copy_options::overwrite_existing);
  const auto deleted = store->deleted_maps();
  ASSERT_THAT(deleted, SizeIs(4));
  std::set<MapId> ids;
  for (const DeletedMap& map : deleted) {
    ids.insert(map.header.id);
    if (map.header.id == MapId{{4}}) {
      EXPECT_FALSE(map.problem);
      continue;
    }
    ASSERT_TRUE(map.problem);
    EXPECT_EQ(map.problem->code, ErrorCode::kDamaged);
    EXPECT_THAT(map.problem->message, HasSubstr(to_hex(map.header.id.bytes)));
    EXPECT_TRUE(store->purge(map.header.id));
  }
  EXPECT_THAT(ids, SizeIs(4)) << "each under its own id";
  EXPECT_THAT(store->deleted_ids(), ElementsAre(MapId{{4}}));
}

}  // namespace
}  // namespace cairn
