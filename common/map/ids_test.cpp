// SPDX-License-Identifier: Apache-2.0
#include "common/map/ids.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <unordered_set>

namespace cairn {
namespace {

TEST(Hex, RoundTripsEveryId) {
  std::mt19937 random(7);
  for (int i = 0; i < 200; ++i) {
    std::array<uint8_t, 16> bytes{};
    for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
    const std::string text = to_hex(bytes);
    EXPECT_EQ(text.size(), 32U);
    EXPECT_EQ(from_hex(text).value(), bytes) << text;
  }
  EXPECT_EQ(to_hex({0x01, 0xab}), "01ab0000000000000000000000000000");
}

TEST(Hex, RefusesWhatItWouldNotPrintAndQuotesIt) {
  const std::string good(32, 'a');
  for (const std::string& bad :
       {std::string("0"), good + "a", good.substr(1), std::string("A").append(good, 1),
        std::string("g").append(good, 1), std::string(" ").append(good, 1), good.substr(1) + "-"}) {
    const auto result = from_hex(bad);
    ASSERT_FALSE(result.has_value()) << bad;
    EXPECT_NE(result.error().message.find(bad), std::string::npos);
  }
}

TEST(Names, AreLowerCaseLettersDigitsAndDashesOf1To32) {
  for (const char* good : {"a", "desk-1", "0", "-", "abcdefghijklmnopqrstuvwxyz012345"}) {
    EXPECT_TRUE(is_valid_name(good)) << good;
  }
  for (const char* bad : {"", "A", "a.b", "a b", "a*", "ä", "a\n", "abcdefghijklmnopqrstuvwxyz0123456"}) {
    EXPECT_FALSE(is_valid_name(bad)) << bad;
  }
}

TEST(ClientIds, AreVersion5UuidsOfTheName) {
  std::set<ClientId> ids;
  for (int i = 0; i < 100; ++i) {
    const std::string name = "client-" + std::to_string(i);
    const ClientId id = client_id_from_name(name);
    EXPECT_EQ(id, client_id_from_name(name));
    EXPECT_EQ(id.bytes[6] >> 4, 5) << "version nibble of " << name;
    EXPECT_EQ(id.bytes[8] >> 6, 2) << "variant bits of " << name;
    ids.insert(id);
  }
  EXPECT_EQ(ids.size(), 100U);
}

TEST(ClientIds, NeverChangeBetweenReleases) {
  EXPECT_EQ(to_hex(client_id_from_name("desk-1").bytes), "3b569314074d5435a8ed54cb50135164");
}

TEST(Ids, ZeroIsNoneAndEqualIdsHashEqual) {
  EXPECT_FALSE(PointId{});
  EXPECT_TRUE(PointId{1});
  EXPECT_FALSE(MapId{});
  MapId map;
  map.bytes[15] = 1;
  EXPECT_TRUE(map);
  std::unordered_set<MapId> maps = {map, MapId{}, map};
  EXPECT_EQ(maps.size(), 2U);
  std::unordered_set<PointId> points = {PointId{3}, PointId{3}, PointId{4}};
  EXPECT_EQ(points.size(), 2U);
}

}  // namespace
}  // namespace cairn
