// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/serialized_blocks.h"

#include <gtest/gtest.h>

#include <vector>

namespace cairn {
namespace {

/// Of a client; counts with the others what was serialized.
struct FakeWriter {
  [[nodiscard]] Result<wire::Serialized<wire::PointPatches>> serialize(
      const wire::PointPatches& message) const {
    if (is_broken) return fail(ErrorCode::kInternal, "broken");
    serialized->push_back({message.epoch, message.block.version});
    return wire::Serialized<wire::PointPatches>{};
  }
  std::vector<std::pair<Epoch, uint64_t>>* serialized;
  bool is_broken = false;
};

class NewestBlocksTest : public ::testing::Test {
 protected:
  bool get(const FakeWriter& writer, Epoch epoch, uint32_t index, uint64_t version) {
    return blocks_.get(writer, MapId{{1}}, epoch, PatchBlock{index, version, {}}).has_value();
  }
  size_t count() const { return serialized_.size(); }

  std::vector<std::pair<Epoch, uint64_t>> serialized_;
  FakeWriter first_{&serialized_};
  FakeWriter second_{&serialized_};
  NewestBlocks<wire::PointPatches> blocks_;
};

TEST_F(NewestBlocksTest, AVersionIsSerializedOnceForAll) {
  for (uint64_t version = 1; version <= 3; ++version) {
    for (const uint32_t index : {0, 1, 7}) {
      const size_t before = count();
      EXPECT_TRUE(get(first_, {1}, index, version));
      EXPECT_TRUE(get(second_, {1}, index, version));
      EXPECT_EQ(count(), before + 1);
    }
  }
}

TEST_F(NewestBlocksTest, WhoIsStillAtAnOlderVersionGetsThatAndDoesNotReplaceTheNewest) {
  ASSERT_TRUE(get(first_, {1}, 0, 5));
  ASSERT_TRUE(get(second_, {1}, 0, 4));
  EXPECT_EQ(serialized_.back(), std::pair(Epoch{1}, uint64_t{4}));
  ASSERT_TRUE(get(first_, {1}, 0, 5));
  EXPECT_EQ(count(), 2U);
}

TEST_F(NewestBlocksTest, VersionsOfTwoEpochsAreNotMixedUp) {
  ASSERT_TRUE(get(first_, {1}, 0, 5));
  ASSERT_TRUE(get(first_, {2}, 0, 5));
  EXPECT_EQ(serialized_.back(), std::pair(Epoch{2}, uint64_t{5}));
  ASSERT_TRUE(get(second_, {1}, 0, 5));  // its burst was begun before the epoch ended
  EXPECT_EQ(serialized_.back(), std::pair(Epoch{1}, uint64_t{5}));
  ASSERT_TRUE(get(second_, {2}, 0, 5));
  EXPECT_EQ(count(), 3U);
}

TEST_F(NewestBlocksTest, WhatCouldNotBeSerializedIsTriedAgain) {
  first_.is_broken = true;
  EXPECT_FALSE(get(first_, {1}, 0, 1));
  EXPECT_TRUE(get(second_, {1}, 0, 1));
  EXPECT_EQ(count(), 1U);
}

}  // namespace
}  // namespace cairn
