// SPDX-License-Identifier: Apache-2.0
#include "common/image/smear.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/image/kernels.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;
using test::Waves;

constexpr int kSide = 64;  // [px] of the images
constexpr Corner kMiddle{kSide / 2, kSide / 2};

GrayImage sharp_image(const Waves<2>& waves, float scale) {
  return test::render(kSide, kSide, [&](int x, int y) {
    return waves(scale * Eigen::Vector2d(x - kMiddle.x, y - kMiddle.y));
  });
}

/// What an image shows whose pixels went the way `smear` meanwhile.
GrayImage smeared_image(const Waves<2>& waves, float scale, const Eigen::Vector2f& smear) {
  constexpr int kParts = 32;
  return test::render(kSide, kSide, [&](int x, int y) {
    double sum = 0;
    for (int k = 0; k < kParts; ++k) {
      const Eigen::Vector2d on_the_way = ((k + 0.5) / kParts - 0.5) * smear.cast<double>();
      sum += waves(scale * (Eigen::Vector2d(x - kMiddle.x, y - kMiddle.y) - on_the_way));
    }
    return sum / kParts;
  });
}

SourcePatch patch_of(const GrayImage& image) {
  SourcePatch patch{};
  EXPECT_TRUE(cut_source_patch(image.view(), kMiddle, &patch));
  return patch;
}

TEST(SmearedTemplateTest, MatchesWhatIsSmearedAsPredictedAndASharpOneDoesNot) {
  for (uint32_t seed = 1; seed <= 24; ++seed) {
    const Waves<2> waves(seed, 0.8);
    const float angle = 0.5F * static_cast<float>(seed);
    const float length = 5 + static_cast<float>(seed % 6);
    const Eigen::Vector2f smear = length * Eigen::Vector2f(std::cos(angle), std::sin(angle));
    // The template is of level 1, from a patch of the same size there.
    const GrayImage image = smeared_image(waves, 1, smear);
    const SourcePatch source = patch_of(sharp_image(waves, 1));
    const Warp warp = 2 * Warp::Identity();
    PatchTemplate sharp;
    PatchTemplate smeared;
    ASSERT_TRUE(make_template(source, warp, 1, &sharp));
    ASSERT_TRUE(make_smeared_template(source, warp, 1, 2 * smear, Eigen::Vector2f::Zero(), &smeared));
    const int of_sharp = zmssd_at(sharp, image.view(), kMiddle.x, kMiddle.y);
    const int of_smeared = zmssd_at(smeared, image.view(), kMiddle.x, kMiddle.y);
    EXPECT_LT(of_smeared, 64 * 10) << "seed " << seed;
    EXPECT_GT(of_sharp, 5 * of_smeared) << "seed " << seed;
  }
}

TEST(SmearedTemplateTest, AsideIsWhatLiesThere) {
  const Waves<2> waves(5, 1.0);
  const GrayImage image = sharp_image(waves, 1);
  const SourcePatch source = patch_of(image);
  PatchTemplate aside;
  ASSERT_TRUE(make_smeared_template(source, Warp::Identity(), 0, {0, 0}, {2, -1}, &aside));
  EXPECT_EQ(zmssd_at(aside, image.view(), kMiddle.x + 2, kMiddle.y - 1), 0);
}

TEST(SmearedTemplateTest, EveryVariantGivesTheSame) {
  std::mt19937 rng(3);
  const TightImage image = TightImage::noise(kSide, kSide, 255, &rng);
  SourcePatch source{};
  ASSERT_TRUE(cut_source_patch(image.view(), kMiddle, &source));
  Warp warp;
  warp << 1.1F, -0.2F, 0.3F, 0.9F;
  for (const float length : {0.3F, 2.5F, 9.0F}) {
    PatchTemplate expected;
    const Eigen::Vector2f smear(length, 0.4F * length);
    ASSERT_TRUE(
        kernels::make_smeared_template(source, warp, 0, smear, {0.3F, -0.4F}, &expected, Simd::kScalar));
    for (const Simd simd : test::simd_variants()) {
      PatchTemplate patch;
      ASSERT_TRUE(kernels::make_smeared_template(source, warp, 0, smear, {0.3F, -0.4F}, &patch, simd));
      EXPECT_EQ(patch.pixels, expected.pixels);
      EXPECT_EQ(patch.gradient_x, expected.gradient_x);
    }
  }
}

TEST(SmearedTemplateTest, ASmearLongerThanThePatchIsShortenedAndWhatIsNoneIsRefused) {
  const Waves<2> waves(7, 0.5);
  const SourcePatch source = patch_of(sharp_image(waves, 1));
  PatchTemplate patch;
  EXPECT_TRUE(make_smeared_template(source, Warp::Identity(), 0, {500, -1e6F}, {0, 0}, &patch));
  const float not_a_number = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(make_smeared_template(source, Warp::Identity(), 0, {not_a_number, 0}, {0, 0}, &patch));
  EXPECT_FALSE(make_smeared_template(source, Warp::Zero(), 0, {3, 0}, {0, 0}, &patch));
}

TEST(SmearTest, IsTheShareOfAShiftAndATurn) {
  TinyMotion motion;
  motion.shift = {0.5F, -0.25F};
  motion.angle = 0.02F;
  const Smear smear(motion, 0.5F, 641, 481);
  EXPECT_TRUE(smear.at({320, 240}).isApprox(Eigen::Vector2f(4, -2)));
  EXPECT_TRUE(smear.at({420, 240}).isApprox(Eigen::Vector2f(4, -1)));
  EXPECT_TRUE(smear.at({320, 340}).isApprox(Eigen::Vector2f(3, -2)));
  motion.score = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(Smear(motion, 0.5F, 641, 481).is_none());
  EXPECT_TRUE(Smear().at({1, 2}).isZero());
}

TEST(SmearTest, WhatAPatchHasAlreadyIsNotAdded) {
  EXPECT_TRUE(missing_smear({0, 5}, {0, 0}).isApprox(Eigen::Vector2f(0, 5)));
  EXPECT_TRUE(missing_smear({0, 5}, {0, 3}).isApprox(Eigen::Vector2f(0, 4)));
  EXPECT_TRUE(missing_smear({0, 5}, {0, -3}).isApprox(Eigen::Vector2f(0, 4)));
  EXPECT_TRUE(missing_smear({0, 5}, {7, 0}).isApprox(Eigen::Vector2f(0, 5)));
  EXPECT_TRUE(missing_smear({0, 5}, {0, 6}).isZero());
  EXPECT_TRUE(missing_smear({0, 0}, {0, 6}).isZero());
}

}  // namespace
}  // namespace cairn
