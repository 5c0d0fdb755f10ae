// SPDX-License-Identifier: Apache-2.0
#include "common/base/repeats.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

TEST(Repeats, WhatComesAgainIsSaidOnceAndThenCounted) {
  const Repeats::TimePoint begin{std::chrono::hours(1)};
  Repeats repeats(seconds(60));
  EXPECT_EQ(repeats.say("no", begin), "no");
  for (int i = 1; i < 600; ++i) EXPECT_FALSE(repeats.say("no", begin + i * milliseconds(100)));
  EXPECT_EQ(repeats.say("never", begin + seconds(1)), "never") << "another reason is news";
  EXPECT_EQ(repeats.say("no", begin + seconds(60)), "no (599 more like it since it was said)");
  EXPECT_FALSE(repeats.say("no", begin + seconds(61)));
  EXPECT_EQ(repeats.rest(), std::vector<std::string>{"no (1 more like it since it was said)"});
  EXPECT_TRUE(repeats.rest().empty());
}

TEST(Repeats, TextsOfOneKindAreFoldedWhateverTheirNumbers) {
  Repeats repeats;
  EXPECT_EQ(repeats.say("outside", "at 1", {}), "at 1");
  for (int i = 2; i < 10; ++i) EXPECT_FALSE(repeats.say("outside", "at " + std::to_string(i), {}));
  EXPECT_EQ(repeats.say("inside", "at 1", {}), "at 1");
}

TEST(Repeats, AnyNumberOfReasonsTakesLittle) {
  Repeats repeats;
  size_t folded = 0;
  for (int i = 0; i < 10'000; ++i) {
    (void)repeats.say(std::to_string(i), {});
    folded += repeats.say(std::to_string(i), {}) ? 0 : 1;
  }
  EXPECT_EQ(folded, 10'000U);
  EXPECT_LE(repeats.rest().size(), 100U);
}

}  // namespace
}  // namespace cairn
