// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/strangers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr MonotonicTime kBegin{std::chrono::hours(1)};

TEST(Strangers, WhoShowsNoKeysIsToldOnceWhetherHeStaysOrGoes) {
  Strangers strangers;
  strangers.came(1, "host a", kBegin);
  strangers.came(2, "host b", kBegin);
  strangers.came(3, "host c", kBegin);
  strangers.came(4, "host d", kBegin + std::chrono::seconds(1));
  strangers.is_let_in(2);
  strangers.gone(2);
  strangers.gone(3);
  EXPECT_THAT(strangers.take(kBegin + std::chrono::seconds(1)),
              ElementsAre(Strangers::Told{"host c", true, kBegin}));
  strangers.came(1, "host a, again", kBegin + std::chrono::seconds(4));
  EXPECT_THAT(strangers.take(kBegin + Strangers::kPatience),
              ElementsAre(Strangers::Told{"host a", false, kBegin}));
  strangers.gone(1);
  EXPECT_THAT(strangers.take(kBegin + Strangers::kPatience), IsEmpty());
  strangers.is_let_in(4);
  strangers.is_let_in(5);
  strangers.came(5, "host e", kBegin);
  EXPECT_THAT(strangers.take(kBegin + std::chrono::hours(1)), IsEmpty());
}

TEST(Strangers, AnyNumberOfThemTakesLittle) {
  Strangers strangers;
  for (uint64_t i = 0; i < 3 * Strangers::kMost; ++i) strangers.came(i, "host a", kBegin);
  EXPECT_THAT(strangers.take(kBegin + Strangers::kPatience), SizeIs(Strangers::kMost));
}

}  // namespace
}  // namespace cairn
