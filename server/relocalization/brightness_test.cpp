// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/brightness.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr int kWidth = 80;
constexpr int kHeight = 60;
constexpr float kScale = 8;  // px of the image to one of its pyramid level 3

/// A small image of good contrast, its grey levels v changed to curve(v), clipped.
template <class Curve>
GrayImage lit(const Curve& curve) {
  static const test::Waves<2> waves(3, 0.9, 14);
  return test::render(kWidth, kHeight, [&](int x, int y) {
    const double grey = 40 + 0.5 * waves({static_cast<double>(x), static_cast<double>(y)});
    return std::clamp(curve(grey), 0.0, 255.0);
  });
}

Eigen::Vector2f pixel_at(int column, int row) {
  return {(static_cast<float>(column) + 0.5F) * kScale - 0.5F,
          (static_cast<float>(row) + 0.5F) * kScale - 0.5F};
}

/// Pearson's, of the local brightness of two images all over them; of places where one tells nothing,
/// without.
double correlation(const GrayImage& a, const GrayImage& b) {
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (int row = 0; row < kHeight - 1; ++row) {
    for (int column = 0; column < kWidth - 1; ++column) {
      const auto p = brightness_at(a.view(), pixel_at(column, row));
      const auto q = brightness_at(b.view(), pixel_at(column, row));
      if (!p || !q) continue;
      const auto u = static_cast<double>(p->local);
      const auto v = static_cast<double>(q->local);
      n += 1, x += u, y += v, xx += u * u, yy += v * v, xy += u * v;
    }
  }
  return (n * xy - x * y) / std::sqrt((n * xx - x * x) * (n * yy - y * y));
}

TEST(WhiteShare, IsTheShareOfPixelsThatAreClipped) {
  GrayImage image(kWidth, kHeight);
  for (int row = 0; row < kHeight; ++row)
    for (int column = 0; column < kWidth; ++column)
      image.row(row)[column] = column < kWidth / 4 ? 254 : column < kWidth / 2 ? 253 : 0;
  EXPECT_EQ(white_share(image), 0.25F);
  EXPECT_EQ(white_share(GrayImage()), 0);
}

TEST(LocalBrightness, OtherLightHardlyMattersAndAnotherImageDoes) {
  const GrayImage image = lit([](double v) { return v; });
  EXPECT_GT(correlation(image, lit([](double v) { return 0.5 * v; })), 0.98);
  EXPECT_GT(correlation(image, lit([](double v) { return v + 40; })), 0.999);
  EXPECT_GT(correlation(image, lit([](double v) { return 255 * std::sqrt(v / 255); })), 0.98);
  EXPECT_GT(correlation(image, lit([](double v) { return v * v / 255; })), 0.98);
  EXPECT_GT(correlation(image, lit([](double v) { return 2 * v; })), 0.7) << "half of it is clipped";
  static const test::Waves<2> other(4, 0.9, 14);
  const GrayImage elsewhere = test::render(kWidth, kHeight, [](int x, int y) {
    return other({static_cast<double>(x), static_cast<double>(y)});
  });
  EXPECT_LT(std::abs(correlation(image, elsewhere)), 0.2);
}

TEST(LocalBrightness, WhereAllAroundIsClippedItTellsNothing) {
  const Eigen::Vector2f centre = pixel_at(40, 30);
  for (const uint8_t limit : {uint8_t{0}, uint8_t{255}}) {
    GrayImage image = test::render(kWidth, kHeight, [&](int, int) { return static_cast<double>(limit); });
    EXPECT_FALSE(brightness_at(image.view(), centre));
    image.row(31)[41] = 100;
    EXPECT_TRUE(brightness_at(image.view(), centre)) << "something shows";
  }
  const GrayImage grey = test::render(kWidth, kHeight, [](int, int) { return 128.0; });
  const auto flat = brightness_at(grey.view(), centre);
  ASSERT_TRUE(flat) << "that it is bare is something to see";
  EXPECT_FLOAT_EQ(flat->local, 0);
}

TEST(LocalBrightness, OutsideThereIsNone) {
  const GrayImage image = lit([](double v) { return v; });
  EXPECT_FALSE(brightness_at(image.view(), {-8, 100}));
  EXPECT_FALSE(brightness_at(image.view(), {100, 8 * kHeight}));
  EXPECT_TRUE(brightness_at(image.view(), pixel_at(0, 0)));
}

}  // namespace
}  // namespace cairn
