// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/crowding.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Crowding, IsWhereLittleRoomIsLeftAndWhatWasRemovedTakesMuch) {
  EXPECT_TRUE(is_crowded(100, 30, 100));
  EXPECT_FALSE(is_crowded(100, 100, 100)) << "full of what lives: nothing would be won";
  EXPECT_TRUE(is_crowded(100, 66, 100)) << "a third would be won, and the map be full for good without";
  EXPECT_FALSE(is_crowded(100, 75, 100));
  EXPECT_FALSE(is_crowded(75, 0, 100)) << "there is room left";
  EXPECT_TRUE(is_crowded(76, 0, 100));
}

}  // namespace
}  // namespace cairn
