// SPDX-License-Identifier: Apache-2.0
#include "client/app/memory_source.h"

#include <gtest/gtest.h>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using testing::ListSource;
using testing::regular_frames;

TEST(MemorySource, GivesFramesAndErrorsInOrderAndThenEnds) {
  auto items = regular_frames(5, 30);
  items[3] = fail(ErrorCode::kDamaged, "3.png: cut");
  ListSource recording(std::move(items));
  MemorySource memory(recording, [] { return false; });
  for (size_t i = 0; i < 5; ++i) {
    const auto item = memory.next();
    ASSERT_EQ(item.has_value(), i != 3);
    if (i == 3) {
      EXPECT_EQ(item.error().message, "3.png: cut");
    } else {
      ASSERT_TRUE(item->has_value());
      EXPECT_EQ((*item)->index, i);
    }
  }
  for (int again = 0; again < 2; ++again) {
    const auto end = memory.next();
    ASSERT_TRUE(end);
    EXPECT_FALSE(end->has_value());
  }
}

TEST(MemorySource, ARequestToStopEndsTheDecoding) {
  ListSource recording(regular_frames(100, 30));
  int asked = 0;
  MemorySource memory(recording, [&asked] { return ++asked > 3; });
  int frames = 0;
  for (auto item = memory.next(); item && *item; item = memory.next()) ++frames;
  EXPECT_EQ(frames, 3);
}

}  // namespace
}  // namespace cairn
