// SPDX-License-Identifier: Apache-2.0
#include "common/image/still_mask.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace cairn {
namespace {

using ::testing::IsEmpty;

constexpr int kWidth = 44, kHeight = 20;  // [px] 5 x 2 cells and a rest

TEST(StillMask, ItsBitsMakeItAgain) {
  const StillMask mask(5, 2, {1, 0, 0, 1, 0, 0, 0, 0, 1, 1});
  const std::vector<uint8_t> bits = bits_of(std::make_shared<const StillMask>(mask));
  EXPECT_EQ(bits, (std::vector<uint8_t>{0b00001001, 0b00000011}));
  EXPECT_EQ(still_mask_bytes(kWidth, kHeight), bits.size());
  const StillMaskPtr again = still_mask_of(kWidth, kHeight, bits);
  ASSERT_NE(again, nullptr);
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 5; ++x) EXPECT_EQ(again->is_still(x, y), mask.is_still(x, y)) << x << ' ' << y;
  }
}

TEST(StillMask, NoBitsAreNoMask) {
  EXPECT_THAT(bits_of(nullptr), IsEmpty());
  EXPECT_EQ(still_mask_of(kWidth, kHeight, {}), nullptr);
  for (const size_t bytes : {1, 2, 3}) {
    const std::vector<uint8_t> unset(bytes, 0);
    EXPECT_EQ(still_mask_of(kWidth, kHeight, unset), nullptr);
  }
  const std::vector<uint8_t> too_many(3, 0xff);
  EXPECT_EQ(still_mask_of(kWidth, kHeight, too_many), nullptr);
}

TEST(StillMask, CoversItsCellsAndTouchesWhatIsBesideThem) {
  std::vector<uint8_t> still(40 * 30, 0);
  still[15 * 40 + 20] = 1;
  const StillMask mask(40, 30, still);
  for (int x = 0; x < 320; x += 3)
    EXPECT_EQ(mask.covers({static_cast<float>(x) + 0.4F, 124.6F}), x / 8 == 20) << x;
  EXPECT_TRUE(mask.touches(155, 124, 0));
  EXPECT_FALSE(mask.covers({155, 124}));
  for (const Eigen::Vector2f& outside :
       {Eigen::Vector2f(-1, 124), Eigen::Vector2f(164, 1e9F), Eigen::Vector2f(NAN, 3)})
    EXPECT_FALSE(mask.covers(outside));
}

/// An image need not be of whole cells.
TEST(StillMask, WhatIsLeftBeyondTheLastCellIsAsThatCell) {
  const StillMask mask(5, 2, {0, 0, 0, 0, 0, 1, 0, 0, 0, 0});
  EXPECT_TRUE(mask.covers({2, kHeight - 1}));
  EXPECT_FALSE(mask.covers({kWidth - 1, kHeight - 1}));
  CornerList corners;
  corners.corners = {{2, kHeight - 1}, {kWidth - 1, kHeight - 1}};
  corners.row_begin.assign(kHeight + 1, 0);
  corners.row_begin.back() = 2;
  mask.remove_from(&corners, 0);
  ASSERT_EQ(corners.corners.size(), 1U);
  EXPECT_EQ(corners.corners[0].x, kWidth - 1);
  EXPECT_EQ(corners.row_begin.back(), 1U);
}

}  // namespace
}  // namespace cairn
