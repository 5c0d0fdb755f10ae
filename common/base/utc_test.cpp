// SPDX-License-Identifier: Apache-2.0
#include "common/base/utc.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace cairn {
namespace {

constexpr int64_t kSecond = 1'000'000'000;

TEST(Utc, IsWrittenAsRfc3339) {
  EXPECT_EQ(to_utc({0}), "1970-01-01T00:00:00Z");
  EXPECT_EQ(to_utc({1'000'000'000 * kSecond + 999'999'999}), "2001-09-09T01:46:40Z");
  EXPECT_EQ(to_utc({951'782'400 * kSecond}), "2000-02-29T00:00:00Z");
}

TEST(Utc, WhatIsWrittenIsReadBack) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int64_t> seconds(0, 7'000'000'000);  // to 2191
  for (int i = 0; i < 1000; ++i) {
    const Timestamp time{seconds(random) * kSecond};
    const auto read = parse_utc(to_utc(time));
    ASSERT_TRUE(read) << to_utc(time);
    EXPECT_EQ(*read, time) << to_utc(time);
  }
}

TEST(Utc, ADayIsItsBeginning) {
  EXPECT_EQ(parse_utc("2001-09-09")->nanoseconds, 999'993'600 * kSecond);
}

TEST(Utc, AnyTimeCanBeShown) {
  EXPECT_EQ(to_utc(Timestamp{std::numeric_limits<int64_t>::max()}), "2262-04-11T23:47:16Z");
  EXPECT_EQ(to_utc(Timestamp{std::numeric_limits<int64_t>::min()}), "1677-09-22T00:00:00Z");
}

TEST(Utc, WhatIsNoTimeIsRefusedByName) {
  for (const char* text :
       {"", "tomorrow", "2026-13-01", "2026-02-30", "2026-12-01T24:00:00Z", "2026-12-01T12:00:00",
        "2026-12-01 12:00:00Z", "3000-01-01", "1969-12-31", "2026-12-01T12:00:00ZZ", "-026-12-01"}) {
    const auto read = parse_utc(text);
    ASSERT_FALSE(read) << text;
    EXPECT_THAT(read.error().message, testing::HasSubstr("'" + std::string(text) + "' is no time"));
  }
}

}  // namespace
}  // namespace cairn
