// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/described_scale.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <tuple>

#include "common/image/patch.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr uint64_t kSeed = 20261124;

GrayImage noise(int width, int height, std::mt19937_64* random) {
  std::uniform_int_distribution<int> grey(0, 255);
  return test::render(width, height, [&](int, int) { return static_cast<double>(grey(*random)); });
}

/// All over the image, and beyond its borders; the other is narrower than what is smoothed around a corner.
TEST(DescribedScale, AFewAreDescribedAsManyAre) {
  std::mt19937_64 random(kSeed);
  for (const auto& [width, height, is_half] :
       {std::tuple(161, 118, false), std::tuple(161, 118, true), std::tuple(31, 300, false)}) {
    const GrayImage image = noise(width, height, &random);
    std::uniform_real_distribution<float> x(-5, static_cast<float>(width) + 5);
    std::uniform_real_distribution<float> y(-5, static_cast<float>(height) + 5);
    constexpr int kCorners = 1000;
    DescribedScale few(image, is_half, 1);
    DescribedScale many(image, is_half, kCorners);
    int described = 0;
    for (int i = 0; i < kCorners; ++i) {
      const Eigen::Vector2f pixel(x(random), y(random));
      Descriptor one{};
      Descriptor other{};
      const bool is_inside = few.describe(pixel, &one);
      ASSERT_EQ(is_inside, many.describe(pixel, &other)) << pixel.transpose();
      EXPECT_EQ(one, other) << pixel.transpose();
      described += is_inside ? 1 : 0;
    }
    EXPECT_GT(described, kCorners / 20);
    EXPECT_LT(described, kCorners * 4 / 5);
  }
}

TEST(DescribedScale, HalfAnOctaveCoarserIsTheImageSampledBilinearly) {
  constexpr float kHalfOctave = 1.41421356F;
  constexpr int kWidth = 100;
  constexpr int kHeight = 80;
  std::mt19937_64 random(kSeed);
  const GrayImage image = noise(kWidth, kHeight, &random);
  const auto along = [](int reduced) { return (static_cast<float>(reduced) + 0.5F) * kHalfOctave - 0.5F; };
  const GrayImage coarser = test::render(70, 56, [&](int x, int y) {
    return std::floor(static_cast<double>(sample_bilinear(image, along(x), along(y))) + 0.5);
  });
  GrayImage smoothed;
  smooth_for_descriptors(coarser, &smoothed);
  DescribedScale scale(image, true, 1);
  for (const Corner corner : {Corner{15, 14}, {35, 28}, {50, 40}}) {
    Descriptor expected{};
    Descriptor found{};
    ASSERT_TRUE(describe(smoothed, corner, &expected));
    ASSERT_TRUE(scale.describe({along(corner.x), along(corner.y)}, &found));
    EXPECT_LE(descriptor_distance(found, expected), 2) << "a grey level may be rounded otherwise";
  }
}

TEST(DescribedScale, WhatLiesFarOutsideIsNotDescribed) {
  std::mt19937_64 random(kSeed);
  const GrayImage image = noise(100, 80, &random);
  Descriptor unused{};
  constexpr float kWrapsAround = 65536 + 50;  // of 16 bits
  EXPECT_FALSE(DescribedScale(image, false, 1).describe({kWrapsAround, 40}, &unused));
}

}  // namespace
}  // namespace cairn
