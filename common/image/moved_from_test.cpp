// SPDX-License-Identifier: Apache-2.0
// What has a size beside its pixels has neither once it is moved from.
#include <gtest/gtest.h>

#include <utility>

#include "common/image/box_sums.h"
#include "common/image/image.h"
#include "common/image/still_mask.h"
#include "common/image/tiny_image.h"

namespace cairn {
namespace {

GrayImage some_image() {
  GrayImage image(70, 50);
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) image.row(y)[x] = static_cast<uint8_t>(7 * x + 13 * y);
  return image;
}

TEST(MovedFrom, AGrayImageIsEmptyAndTakesAnother) {
  GrayImage image = some_image();
  const GrayImage taken = std::move(image);
  EXPECT_EQ(taken.width(), 70);
  EXPECT_TRUE(image.empty());  // NOLINT(bugprone-use-after-move): what the test is about
  EXPECT_EQ(image.view().stride, 0);
  image.assign(taken);  // as large as before: it must not count on the memory that is gone
  EXPECT_EQ(image.row(49)[69], taken.row(49)[69]);
  GrayImage other(5, 5);
  other = std::move(image);
  EXPECT_TRUE(image.empty());  // NOLINT(bugprone-use-after-move)
  EXPECT_EQ(other.row(49)[69], taken.row(49)[69]);
}

TEST(MovedFrom, ATinyImageIsEmpty) {
  TinyImage image(some_image(), 0.75F);
  const size_t count = image.count();
  const TinyImage copy = image;
  EXPECT_EQ(image.count(), count) << "a copy takes nothing away";
  const TinyImage taken = std::move(image);
  EXPECT_EQ(taken.count(), count);
  EXPECT_EQ(taken.values(), copy.values());
  EXPECT_TRUE(image.empty());  // NOLINT(bugprone-use-after-move)
  EXPECT_EQ(image.width(), 0);
  EXPECT_EQ(image.height(), 0);
  EXPECT_EQ(image.count(), 0U);
}

TEST(MovedFrom, SumsAndMasksHaveNoSize) {
  BoxSums sums(some_image());
  const BoxSums taken_sums = std::move(sums);
  EXPECT_GT(taken_sums.width(), 0);
  EXPECT_EQ(sums.width(), 0);  // NOLINT(bugprone-use-after-move)
  EXPECT_EQ(sums.height(), 0);
  StillMask mask(4, 3, std::vector<uint8_t>(12, 1));
  const StillMask taken_mask = std::move(mask);
  EXPECT_TRUE(taken_mask.covers({9, 9}));
  EXPECT_FALSE(mask.covers({9, 9}));  // NOLINT(bugprone-use-after-move)
  EXPECT_FALSE(mask.covers({3, 3}));
  EXPECT_FALSE(mask.touches(1, 1, 0));
}

}  // namespace
}  // namespace cairn
