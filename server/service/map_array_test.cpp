// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_array.h"

#include <gtest/gtest.h>

#include <set>

#include "server/service/client.h"

namespace cairn {
namespace {

TEST(MapArray, IdsFollowTheSeedAndAreRandomWithout) {
  MapArray first(7);
  MapArray second(7);
  MapArray other(8);
  MapArray random(0);
  MapArray random_too(0);
  std::set<MapId> seen;
  for (int i = 0; i < 100; ++i) {
    const MapId id = first.next_id();
    EXPECT_EQ(id, second.next_id());
    for (const MapId each : {id, other.next_id(), random.next_id(), random_too.next_id()}) {
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
  const MapId id = first.repeatable_id(seed);
  EXPECT_EQ(id, second.repeatable_id(seed));
  EXPECT_NE(id, second.repeatable_id(other));
  first.add(id, MapEntry{"map-1", {}, {}, {}, {}});
  EXPECT_NE(id, first.repeatable_id(seed)) << "taken";
  second.reserve(id);
  EXPECT_NE(id, second.repeatable_id(seed)) << "of a map that may come back";

  MapArray with_seed(7);
  MapArray with_seed_too(7);
  EXPECT_EQ(with_seed.repeatable_id(seed), with_seed_too.next_id()) << "the server's own seed goes first";
}

TEST(MapArray, NamesAreUniqueAndAWishIsGrantedWhenItCanBe) {
  MapArray maps(1);
  const auto take = [&maps](const std::string& wish) {
    const std::string name = maps.free_name(wish);
    maps.add(maps.next_id(), MapEntry{name, {}, {}, {}, {}});
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
  const MapId id = maps.next_id();
  maps.add(id, MapEntry{"desk", {}, {}, {}, {}}).seeding = true;
  EXPECT_FALSE(maps.is_free("desk")) << "being made";
  EXPECT_FALSE(maps.is_free(to_hex(id.bytes))) << "operators call it so, too";
  EXPECT_NE(maps.free_name(to_hex(id.bytes)), to_hex(id.bytes));
  EXPECT_TRUE(maps.is_free("bench"));
  maps.remove(id);
  EXPECT_TRUE(maps.is_free("desk"));
}

TEST(MapArray, ARefusedSeedGivesItsNameBack) {
  MapArray maps(1);
  const MapId id = maps.next_id();
  maps.add(id, MapEntry{maps.free_name(""), {}, {}, {}, {}});
  EXPECT_EQ(maps.live_count(), 0U) << "not made yet";
  maps.remove(id);
  EXPECT_EQ(maps.free_name(""), "map-1");
  EXPECT_EQ(maps.find(id), nullptr);
}

TEST(MapArray, ARestingMapThatIsOfferedAKeyframeCountsAsAwake) {
  MapArray maps(1);
  MapEntry& entry = maps.add(maps.next_id(), MapEntry{"desk", {}, {}, {}, {}});
  entry.statistics.bytes = 1000;
  entry.statistics.bytes_let_go = 5000;
  const size_t indexed = bytes_indexed(0, 0);
  EXPECT_EQ(maps.bytes(), 1000U + indexed);
  EXPECT_EQ(bytes_to_wake(entry), 5000U);
  ++entry.offers_in_work;
  EXPECT_EQ(maps.bytes(), 6000U + indexed);
  EXPECT_EQ(bytes_to_wake(entry), 0U) << "they count already";
}

const wire::PeerId kProcess{{1}};

TEST(CameraList, KeepsFewAndRefusesTheUnusable) {
  CameraList cameras;
  cameras.set_holder(kProcess);
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  for (uint32_t version = 1; version <= 3; ++version) {
    message.version = version;
    EXPECT_TRUE(cameras.put(kProcess, message));
  }
  EXPECT_EQ(cameras.find(0, 1), nullptr) << "two versions are kept";
  EXPECT_NE(cameras.find(0, 2), nullptr);
  EXPECT_NE(cameras.find(0, 3), nullptr);
  message.version = 4;
  message.parameters.values[0] = -1;
  EXPECT_FALSE(cameras.put(kProcess, message));
  message.parameters.values[0] = 500;
  int taken = 1;
  for (uint32_t camera = 1; camera < 100; ++camera) {
    message.camera = camera;
    taken += cameras.put(kProcess, message) ? 1 : 0;
  }
  EXPECT_EQ(taken, 8);
}

TEST(CameraList, KnowsHowFarACameraIsBelieved) {
  CameraList cameras;
  cameras.set_holder(kProcess);
  wire::CameraMessage message;
  message.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
  ASSERT_TRUE(cameras.put(kProcess, message));
  EXPECT_FALSE(cameras.find(0, 1)->doubt_of({{}, 0, 1})) << "exact";
  message.version = 2;
  message.sigma = {50, 50, 0, 0, 0.1, 0, 0, 0, 0};
  message.frozen = false;
  ASSERT_TRUE(cameras.put(kProcess, message));
  const auto doubt = cameras.find(0, 2)->doubt_of({{}, 0, 2});
  ASSERT_TRUE(doubt);
  EXPECT_EQ(doubt->sigma, Intrinsics(0.1, 0.1));
  message.version = 3;
  message.frozen = true;
  ASSERT_TRUE(cameras.put(kProcess, message));
  EXPECT_FALSE(cameras.find(0, 3)->doubt_of({{}, 0, 3})) << "known";
  message.version = 4;
  message.frozen = false;
  message.parameters.values[0] = 1e300;
  EXPECT_FALSE(cameras.put(kProcess, message)) << "neither exact nor one that could be found out";
}

}  // namespace
}  // namespace cairn
