// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_array.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <string>

#include "server/service/client.h"

namespace cairn {
namespace {

TEST(MapArray, IdsFollowTheSeedAndAreRandomWithout) {
  MapArray first(7);
  MapArray second(7);
  MapArray other(8);
  std::random_device device;
  MapArray random(0, [&] { return device(); });
  MapArray random_too(0, [&] { return device(); });
  std::set<MapId> seen;
  for (int i = 0; i < 100; ++i) {
    const MapId id = first.ids().next();
    EXPECT_EQ(id, second.ids().next());
    for (const MapId each : {id, other.ids().next(), random.ids().next(), random_too.ids().next()}) {
      EXPECT_TRUE(static_cast<bool>(each));
      EXPECT_TRUE(seen.insert(each).second) << "id twice";
    }
  }
}

TEST(MapArray, InLockstepIdsFollowWhatTheTrackerSaw) {
  wire::MapSeed seed;
  seed.lockstep = true;
  seed.first_time = {1};
  seed.second_time = {2};
  seed.trails = {{TrailId{1}, {10, 20}, {11, 20}}};
  wire::MapSeed other = seed;
  other.trails[0].second.x() = 12;

  MapArray first(0);
  MapArray second(0);
  const MapId id = first.ids().repeatable(seed);
  EXPECT_EQ(id, second.ids().repeatable(seed));
  EXPECT_NE(id, second.ids().repeatable(other));
  first.add(id, MapEntry{"map-1", {}, {}, {}, {}});
  EXPECT_NE(id, first.ids().repeatable(seed)) << "taken";
  second.ids().reserve(id);
  EXPECT_NE(id, second.ids().repeatable(seed)) << "of a map that may come back";

  MapArray with_seed(7);
  MapArray with_seed_too(7);
  EXPECT_EQ(with_seed.ids().repeatable(seed), with_seed_too.ids().next())
      << "the server's own seed goes first";
}

TEST(MapArray, NamesAreUniqueAndAWishIsGrantedWhenItCanBe) {
  MapArray maps(1);
  const auto take = [&maps](const std::string& wish) {
    const std::string name = maps.names().free(wish);
    maps.add(maps.ids().next(), MapEntry{name, {}, {}, {}, {}});
    return name;
  };
  EXPECT_EQ(take(""), "map-1");
  EXPECT_EQ(take("desk"), "desk");
  EXPECT_EQ(take("desk"), "desk-2");
  EXPECT_EQ(take("map-2"), "map-2");
  EXPECT_EQ(take(""), "map-3");
  EXPECT_EQ(take("../../etc"), "map-4") << "not a name";
  const std::string longest(32, 'a');
  EXPECT_EQ(take(longest), longest);
  EXPECT_TRUE(is_valid_name(take(longest)));
}

TEST(MapArray, ANameThatIsSomeMapsNameOrIdIsNotFree) {
  MapArray maps(1);
  const MapId id = maps.ids().next();
  maps.add(id, MapEntry{"desk", {}, {}, {}, {}}).seeding = true;
  EXPECT_FALSE(maps.names().is_free("desk")) << "being made";
  EXPECT_FALSE(maps.names().is_free(to_hex(id.bytes))) << "operators call it so, too";
  EXPECT_NE(maps.names().free(to_hex(id.bytes)), to_hex(id.bytes));
  EXPECT_TRUE(maps.names().is_free("bench"));
  maps.remove(id);
  EXPECT_TRUE(maps.names().is_free("desk"));
}

TEST(MapArray, ARefusedSeedGivesItsNameBack) {
  MapArray maps(1);
  const MapId id = maps.ids().next();
  maps.add(id, MapEntry{maps.names().free(""), {}, {}, {}, {}});
  EXPECT_EQ(maps.live_count(), 0U) << "not made yet";
  maps.remove(id);
  EXPECT_EQ(maps.names().free(""), "map-1");
  EXPECT_EQ(maps.find(id), nullptr);
}

TEST(MapArray, AnIdleMapThatIsOfferedAKeyframeCountsAsInUse) {
  MapArray maps(1);
  MapEntry& entry = maps.add(maps.ids().next(), MapEntry{"desk", {}, {}, {}, {}});
  MapStatistics statistics;
  statistics.bytes = 1000;
  statistics.evicted_bytes = 5000;
  maps.measured(&entry, statistics);
  const size_t indexed = bytes_indexed(0, 0);
  EXPECT_EQ(maps.bytes(), 1000U + indexed);
  EXPECT_EQ(bytes_to_page_in(entry), 5000U);
  maps.begin_offer(&entry);
  EXPECT_EQ(maps.bytes(), 6000U + indexed);
  EXPECT_EQ(bytes_to_page_in(entry), 0U) << "they count already";
}

MapSnapshotPtr snapshot_of(size_t points) {
  auto patches = std::make_shared<PatchBlock>();
  patches->points.resize(points);
  auto made = std::make_shared<MapSnapshot>();
  auto block = std::make_shared<PointBlock>();
  block->patches = std::move(patches);
  made->point_blocks.push_back(std::move(block));
  return made;
}

TEST(MapArray, TheIdOfAMapThatWasShownIsNotGivenToAnother) {
  wire::MapSeed seed;
  seed.lockstep = true;
  seed.trails = {{TrailId{1}, {10, 20}, {11, 20}}};
  MapArray maps(0);
  const MapId id = maps.ids().repeatable(seed);
  maps.add(id, MapEntry{"refused", {}, {}, {}, {}});
  maps.remove(id);
  EXPECT_EQ(maps.ids().repeatable(seed), id) << "nobody has seen it";
  maps.show(&maps.add(id, MapEntry{"taken-back", {}, {}, {}, {}}), snapshot_of(1), {});
  maps.remove(id);
  EXPECT_NE(maps.ids().repeatable(seed), id) << "replicas would mix the two";
}

/// The sum and the names as somebody would find them who goes through all maps.
class CountedMaps {
 public:
  void check(std::mt19937& random) {
    size_t sum = 0;
    std::set<std::string> names;
    for (const auto& [id, entry] : maps_.all()) {
      MapEntry alone = entry;
      alone.bytes_published = 0;
      size_t points = 0;
      if (entry.snapshot) points = entry.snapshot->point_blocks[0]->patches->points.size();
      sum += bytes_of(alone) +
             points * (sizeof(PointSource) + sizeof(Eigen::Vector3f) + sizeof(PointVisibility));
      names.insert(entry.name);
      if (!entry.name_to_be.empty()) names.insert(entry.name_to_be);
    }
    ASSERT_EQ(maps_.bytes(), sum);
    uint64_t number = 1;
    while (names.contains("map-" + std::to_string(number))) ++number;
    ASSERT_EQ(maps_.names().free(""), "map-" + std::to_string(number));
    const std::string any = "map-" + std::to_string(random() % 12);
    ASSERT_EQ(maps_.names().is_free(any), !names.contains(any)) << any;
  }

  void change_something(std::mt19937& random) {
    const MapId id{{static_cast<uint8_t>(random() % 8)}};
    MapEntry* entry = maps_.find(id);
    const std::string name = "map-" + std::to_string(random() % 12);
    MapStatistics statistics;
    statistics.bytes = random() % 10'000;
    statistics.evicted_bytes = random() % 10'000;
    statistics.keyframes = random() % 100;
    if (entry == nullptr) {
      maps_.add(id, MapEntry{maps_.names().free(random() % 2 == 0 ? name : ""), {}, {}, {}, {}});
      return;
    }
    switch (random() % 6) {
      case 0:
        return maps_.remove(id);
      case 1:
        return maps_.show(entry, snapshot_of(random() % 64), statistics);
      case 2:
        return maps_.measured(entry, statistics);
      case 3:
        return maps_.begin_offer(entry);
      case 4:
        if (entry->offers_in_work > 0) maps_.end_offer(entry);
        return;
      default:
        if (!entry->name_to_be.empty()) return maps_.end_renaming(entry, random() % 2 == 0);
        if (maps_.names().is_free(name)) maps_.begin_renaming(entry, name);
    }
  }

 private:
  MapArray maps_{1};
};

TEST(MapArray, WhatIsKeptCountOfIsWhatIsThere) {
  CountedMaps maps;
  std::mt19937 random(3);
  for (int i = 0; i < 5000; ++i) {
    maps.change_something(random);
    maps.check(random);
    if (::testing::Test::HasFatalFailure()) FAIL() << "after " << i << " changes";
  }
}

const wire::PeerId kProcess{{1}};
const MonotonicTime kAnnouncedAt{std::chrono::hours(1)};

TEST(CameraList, KeepsFewAndRefusesTheUnusable) {
  CameraList cameras;
  cameras.set_holder(kProcess);
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  for (uint32_t version = 1; version <= 3; ++version) {
    message.version = version;
    EXPECT_TRUE(cameras.put(kProcess, message, kAnnouncedAt));
  }
  EXPECT_EQ(cameras.find(0, 1), nullptr) << "two versions are kept";
  EXPECT_NE(cameras.find(0, 2), nullptr);
  EXPECT_NE(cameras.find(0, 3), nullptr);
  message.version = 4;
  message.parameters.values[0] = -1;
  EXPECT_FALSE(cameras.put(kProcess, message, kAnnouncedAt));
  message.parameters.values[0] = 500;
  int taken = 1;
  for (uint32_t camera = 1; camera < 100; ++camera) {
    message.camera = camera;
    taken += cameras.put(kProcess, message, kAnnouncedAt) ? 1 : 0;
  }
  EXPECT_EQ(taken, 8);
}

TEST(CameraList, WhatOneProcessAnnouncesTooOftenCountsAgainstNoOther) {
  CameraList cameras;
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  int taken = 0;
  for (int i = 0; i < 10'000; ++i) taken += cameras.put(kProcess, message, kAnnouncedAt) ? 1 : 0;
  EXPECT_EQ(taken, 300);
  EXPECT_TRUE(cameras.put(wire::PeerId{{2}}, message, kAnnouncedAt));
  EXPECT_TRUE(cameras.put(kProcess, message, kAnnouncedAt + std::chrono::seconds(1)));
}

TEST(CameraList, ManyProcessesAreNoWayRoundTheRate) {
  CameraList cameras;
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  int taken = 0;
  for (int i = 0; i < 10'000; ++i) {
    const wire::PeerId process{{static_cast<uint8_t>(i % 100)}};
    taken += cameras.put(process, message, kAnnouncedAt) ? 1 : 0;
  }
  EXPECT_LE(taken, 20 + 8 * 100) << "those that are kept, and few others";
}

TEST(CameraList, KnowsHowFarACameraIsBelieved) {
  CameraList cameras;
  cameras.set_holder(kProcess);
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  ASSERT_TRUE(cameras.put(kProcess, message, kAnnouncedAt));
  EXPECT_FALSE(cameras.find(0, 1)->prior_of({{}, 0, 1})) << "exact";
  message.version = 2;
  message.sigma = {50, 50, 0, 0, 0.1, 0, 0, 0, 0};
  message.frozen = false;
  ASSERT_TRUE(cameras.put(kProcess, message, kAnnouncedAt));
  const auto prior = cameras.find(0, 2)->prior_of({{}, 0, 2});
  ASSERT_TRUE(prior);
  EXPECT_EQ(prior->sigma, Intrinsics(0.1, 0.1));
  message.version = 3;
  message.frozen = true;
  ASSERT_TRUE(cameras.put(kProcess, message, kAnnouncedAt));
  EXPECT_FALSE(cameras.find(0, 3)->prior_of({{}, 0, 3})) << "known";
  message.version = 4;
  message.frozen = false;
  message.parameters.values[0] = 1e300;
  EXPECT_FALSE(cameras.put(kProcess, message, kAnnouncedAt))
      << "neither exact nor one that could be calibrated";
}

}  // namespace
}  // namespace cairn
