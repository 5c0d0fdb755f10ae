// SPDX-License-Identifier: Apache-2.0
#include "common/base/simd.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(SimdLanes, MoveUpBringsEachIntoTheNextOneAndAZeroIntoTheFirst) {
  const I16x8 lanes = {11, -12, 13, -14, 15, -16, 17, -18};
  const I16x8 moved = move_up(lanes);
  EXPECT_EQ(moved[0], 0);
  for (int lane = 1; lane < 8; ++lane) EXPECT_EQ(moved[lane], lanes[lane - 1]) << lane;
}

}  // namespace
}  // namespace cairn
