// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/kept_template.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "common/image/smear.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

GrayImage texture(double frequency) {
  const test::Waves<2> waves(2, frequency);
  return test::render(128, 96, [&](int x, int y) { return waves({x, y}); });
}

SourcePatch patch_at(const GrayView& image, int x, int y) {
  SourcePatch patch{};
  EXPECT_TRUE(cut_source_patch(image, {static_cast<int16_t>(x), static_cast<int16_t>(y)}, &patch));
  return patch;
}

TEST(KeptTemplateTest, OnlyASmearOfAPixelAndAHalfOfTheLevelIsOne) {
  const GrayImage image = texture(1);
  const SourcePatch source = patch_at(image.view(), 64, 48);
  const Warp warp = 2 * Warp::Identity();
  KeptTemplate kept;
  const auto pixels = [&](float smear) { return kept.of(source, warp, 1, {smear, 0}, {})->pixels; };
  const auto sharp = pixels(0);
  EXPECT_EQ(pixels(5.9F), sharp);
  const auto smeared = pixels(8);
  EXPECT_NE(smeared, sharp);
  EXPECT_EQ(pixels(8.5F), smeared) << "it looks the same, nearly";
  EXPECT_NE(pixels(12), smeared);
  EXPECT_EQ(pixels(0), sharp);
}

TEST(KeptTemplateTest, WhereASmearLeavesNoCornersEveryPixelOfACoarseLevelIsLookedAt) {
  constexpr int kLevel = 2;
  constexpr int kReach = 3;
  const test::Waves<2> waves(2, 0.1);
  FrameImages frame;
  frame.build_pyramid(test::render(512, 384, [&](int x, int y) { return waves({x, y}); }).view());
  const auto has_corner = [&](int x, int y) {
    const auto& corners = frame.corners(kLevel).corners;
    return std::any_of(corners.begin(), corners.end(), [&](const Corner& c) {
      return std::max(std::abs(c.x - x), std::abs(c.y - y)) <= 2 * kReach;
    });
  };
  const Eigen::Vector2f off(1, -2);
  TinyMotion motion;
  motion.shift = {1, 0};
  int tried = 0;
  for (int x = 32; x < 96; x += 8) {
    if (has_corner(x, 48)) continue;
    ++tried;
    PatchTemplate patch;
    ASSERT_TRUE(make_template(patch_at(frame.pyramid.level(kLevel).view(), x, 48), 4 * Warp::Identity(),
                              kLevel, &patch));
    const Eigen::Vector2f truth = Eigen::Vector2i(x, 48).cast<float>();
    frame.smear = {};
    EXPECT_FALSE(look_around(patch, frame, truth + off, kReach, 10, {}));
    frame.smear = Smear(motion, 1, 512, 384);
    const auto found = look_around(patch, frame, truth + off, kReach, 10, {});
    ASSERT_TRUE(found) << x;
    EXPECT_LT((*found - truth).norm(), 0.1F);
  }
  EXPECT_GT(tried, 0);
}

}  // namespace
}  // namespace cairn
