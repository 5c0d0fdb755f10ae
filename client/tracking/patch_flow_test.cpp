// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/patch_flow.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;

/// A texture seen `aside` px aside, with Gaussian noise of `sigma` grey levels.
void show(const Eigen::Vector2d& aside, double sigma, uint32_t seed, FrameImages* frame) {
  const test::Waves<2> waves(5, 0.6, 60);
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, sigma);
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double value = waves(Eigen::Vector2d(x, y) - aside) + noise(random);
      image.row(y)[x] = static_cast<uint8_t>(std::clamp(std::lround(value), 0L, 255L));
    }
  }
  frame->build_pyramid(image.view());
}

/// Of points all over the image that stay in it, how many are followed, and how many of these to within a
/// pixel.
struct Followed {
  int tried = 0, found = 0, right = 0;
};
Followed follow_all(const Eigen::Vector2d& aside, double sigma) {
  FrameImages previous;
  FrameImages now;
  show({0, 0}, sigma, 1, &previous);
  show(aside, sigma, 2, &now);
  Followed all;
  for (float y = 60; y < kHeight - 60; y += 12) {
    for (float x = 60; x < kWidth - 60; x += 12) {
      const Eigen::Vector2f from(x, y);
      ++all.tried;
      const auto there = follow_patch(previous, now, from, from, PatchFlowOptions());
      if (!there) continue;
      ++all.found;
      all.right += (*there - from - aside.cast<float>()).norm() < 1 ? 1 : 0;
    }
  }
  return all;
}

TEST(PatchFlow, AStepOfTenPixelsNeedsNoPrior) {
  const Followed all = follow_all({9, -4}, 1);
  EXPECT_GT(all.found, 0.6 * all.tried);
  EXPECT_GT(all.right, 0.97 * all.found);
}

// At level 0 the noise leaves little to align; of four of its pixels each the mean is better.
TEST(PatchFlow, NoiseDoesNotEndIt) {
  const Followed all = follow_all({1.5, 0.5}, 14);
  EXPECT_GT(all.found, 0.6 * all.tried);
  EXPECT_GT(all.right, 0.9 * all.found);
}

TEST(PatchFlow, WhatIsNotThereIsNotFound) {
  FrameImages previous;
  FrameImages now;
  show({0, 0}, 1, 1, &previous);
  show({131, 67}, 1, 2, &now);  // another part of the texture
  int found = 0;
  int tried = 0;
  for (float y = 60; y < kHeight - 60; y += 12) {
    for (float x = 60; x < kWidth - 60; x += 12) {
      ++tried;
      found += follow_patch(previous, now, {x, y}, {x, y}, PatchFlowOptions()) ? 1 : 0;
    }
  }
  EXPECT_LT(found, 0.15 * tried);
}

TEST(PatchFlow, APixelMovesAsTheSmallImageDoes) {
  const GrayImage image(kWidth, kHeight);
  const Eigen::Vector2f center((kWidth - 1) / 2.0F, (kHeight - 1) / 2.0F);
  TinyMotion motion;
  motion.shift = {0.5F, -0.25F};
  EXPECT_TRUE(moved_by(motion, {100, 50}, image).isApprox(Eigen::Vector2f(108, 46)));
  motion.shift.setZero();
  motion.angle = static_cast<float>(M_PI / 2);
  EXPECT_TRUE(
      moved_by(motion, center + Eigen::Vector2f(10, 0), image).isApprox(center + Eigen::Vector2f(0, 10)));
}

}  // namespace
}  // namespace cairn
