// SPDX-License-Identifier: Apache-2.0
// Backup and verification of a store while it is in use.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/integration/administered_fixture.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;

class StoreAdministrationTest : public testing::AdministeredFixture {
 protected:
  /// Below the store's folder, by number.
  static std::string part(size_t number) {
    std::string id(32, '0');
    for (size_t digit = id.size(); number > 0; number /= 10)
      id[--digit] = static_cast<char>('0' + number % 10);
    return "deleted/" + id + ".cairnmap";
  }
};

/// Of more files than one answer names, some go while the pages are asked for.
TEST_F(StoreAdministrationTest, AListOfFilesDoesNotEndWhereOneHasGone) {
  constexpr size_t kFiles = 1500;
  for (size_t i = 0; i < kFiles; ++i) std::ofstream(service_options_.store / part(i));
  for (const char* verb : {"backup", "verify"}) {
    json page = done({{"verb", verb}, {"after", ""}});
    ASSERT_TRUE(page["more"]) << page.size();
    const size_t listed = page["parts"].size();
    const std::string last = page["parts"].back();
    EXPECT_EQ(last, part(listed - 1));
    std::filesystem::remove(service_options_.store / last);
    page = done({{"verb", verb}, {"after", last}});
    EXPECT_FALSE(page["more"]);
    ASSERT_FALSE(page["parts"].empty());
    EXPECT_EQ(page["parts"].front(), part(listed));
    EXPECT_EQ(page["parts"].back(), "site.db");
    EXPECT_EQ(page["parts"].size(), kFiles - listed + 2);
    std::ofstream(service_options_.store / last);
  }
}

TEST_F(StoreAdministrationTest, WhatWasDeletedLongAgoGoesWhereTheOperatorWantsThat) {
  make_map();
  done({{"verb", "delete"}, {"map", "map-1"}});
  const auto file = service_options_.store / ("deleted/" + to_hex(map_.bytes) + ".cairnmap");
  const auto start_again = [&](std::chrono::hours keep) {
    service_.reset();
    service_options_.keep_deleted = keep;
    start_service_again();
    connect();
  };
  start_again(48h);
  EXPECT_EQ(done({{"verb", "maps"}})["deleted"].size(), 1U);
  std::filesystem::last_write_time(file, std::filesystem::file_time_type::clock::now() - 72h);
  start_again(0h);
  EXPECT_EQ(done({{"verb", "maps"}})["deleted"].size(), 1U) << "operators purge";
  start_again(48h);
  EXPECT_TRUE(testing::eventually([&] { return done({{"verb", "maps"}})["deleted"].empty(); }));
  EXPECT_FALSE(std::filesystem::exists(file));
  EXPECT_EQ(done({{"verb", "audit"}, {"action", "purge"}})["entries"][0]["who"], "server");
}

TEST_F(StoreAdministrationTest, AMapThatGoesWhileItIsAskedForHasGone) {
  make_map();
  const std::string map = "maps/" + to_hex(map_.bytes) + ".cairnmap";
  const json sound = done({{"verb", "verify-part"}, {"part", map}});
  EXPECT_TRUE(sound["faults"].empty()) << sound;
  EXPECT_EQ(sound["keyframes"], 2);
  done({{"verb", "delete"}, {"map", "map-1"}});
  EXPECT_EQ(done({{"verb", "verify-part"}, {"part", map}}), (json{{"gone", true}}));
  done({{"verb", "backup"}, {"after", ""}});
  EXPECT_EQ(done({{"verb", "backup-part"}, {"part", map}}), (json{{"gone", true}}));
}

}  // namespace
}  // namespace cairn
