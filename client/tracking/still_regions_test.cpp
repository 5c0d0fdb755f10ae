// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/still_regions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "common/image/frame_images.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;
constexpr double kRadius = 110;  // of the lens's circle [px]

using Grey = std::function<double(int x, int y)>;

/// A camera that looks at a texture, and what it shows besides.
class StillRegionsTest : public ::testing::Test {
 protected:
  [[nodiscard]] double scene(int x, int y) const { return texture_.at(x, y); }
  [[nodiscard]] static Pyramid shown(const Grey& grey) {
    GrayImage image(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x)
        image.row(y)[x] = static_cast<uint8_t>(std::clamp(std::lround(grey(x, y)), 0L, 255L));
    }
    Pyramid pyramid;
    pyramid.build(image.view());
    return pyramid;
  }
  /// Frames of a camera that moves by `step` px a frame.
  void look(int frames, const Eigen::Vector2i& step,
            const std::function<double(double scene, int x, int y)>& through) {
    for (int i = 0; i < frames; ++i) {
      (void)still_.learn(
          shown([&](int x, int y) { return through(scene(x + i * step.x(), y + i * step.y()), x, y); }));
    }
  }
  [[nodiscard]] size_t still_cells() const { return still_.mask() ? still_.mask()->still_cells() : 0; }
  [[nodiscard]] static bool in_circle(int x, int y, double radius) {
    return std::hypot(x - kWidth / 2.0, y - kHeight / 2.0) < radius;
  }
  /// Dark squares in a corner of the image, as letters are.
  [[nodiscard]] static bool is_mark(int x, int y) {
    return x >= 24 && x < 96 && y >= 16 && y < 32 && (x / 6 + y / 6) % 2 == 0;
  }

  test::Leaves texture_{3};
  StillRegions still_{StillRegionsOptions()};
};

TEST_F(StillRegionsTest, WhatMovesIsNotMasked) {
  look(60, {3, 2}, [](double scene, int, int) { return scene; });
  EXPECT_EQ(still_cells(), 0U);
}

TEST_F(StillRegionsTest, AWaterMarkIsFoundAndNothingElse) {
  look(40, {3, 2}, [](double scene, int x, int y) { return is_mark(x, y) ? 0.3 * scene : scene; });
  ASSERT_TRUE(still_.mask());
  for (int y = 0; y < still_.mask()->height(); ++y) {
    for (int x = 0; x < still_.mask()->width(); ++x) {
      if (!still_.mask()->is_still(x, y)) continue;
      EXPECT_TRUE(x >= 2 && x <= 12 && y >= 1 && y <= 4) << x << " " << y;
    }
  }
  EXPECT_GE(still_cells(), 12U) << "of 18";
}

TEST_F(StillRegionsTest, TheCircleOfALensIsMaskedAndWhatIsInItIsNot) {
  look(40, {3, 2}, [](double scene, int x, int y) { return in_circle(x, y, kRadius) ? scene : 8.0; });
  ASSERT_TRUE(still_.mask());
  int outside = 0;
  int masked = 0;
  for (int y = 0; y < still_.mask()->height(); ++y) {
    for (int x = 0; x < still_.mask()->width(); ++x) {
      const int u = 8 * x + 4;
      const int v = 8 * y + 4;
      const bool is_still = still_.mask()->is_still(x, y);
      if (!in_circle(u, v, kRadius + 12)) {
        ++outside;
        masked += is_still ? 1 : 0;
      }
      if (in_circle(u, v, kRadius - 24)) {
        EXPECT_FALSE(is_still) << u << " " << v;
      }
    }
  }
  EXPECT_EQ(masked, outside);
}

// A hand before it moves; the camera does not.
TEST_F(StillRegionsTest, ACameraAtRestMasksNothing) {
  for (int i = 0; i < 60; ++i) {
    (void)still_.learn(shown([&](int x, int y) {
      const bool is_hand = std::hypot(x - 40 - 4 * i, y - 120) < 50;
      return is_hand ? scene(x - 4 * i + 500, y) : scene(x, y);
    }));
  }
  EXPECT_EQ(still_cells(), 0U);
}

// A dark wall that fills the side of the image for a while has an edge that moves.
TEST_F(StillRegionsTest, AnEdgeThatMovesIsNoBorder) {
  for (int i = 0; i < 40; ++i) {
    (void)still_.learn(
        shown([&](int x, int y) { return x < 120 - 2 * i ? 20.0 : scene(x + 3 * i, y + 2 * i); }));
  }
  EXPECT_EQ(still_cells(), 0U);
}

TEST_F(StillRegionsTest, ABorderThatBrightensIsNone) {
  look(40, {3, 2}, [](double scene, int x, int y) { return in_circle(x, y, kRadius) ? scene : 8.0; });
  const size_t before = still_cells();
  ASSERT_GT(before, 0U);
  const Pyramid whole = shown([&](int x, int y) { return scene(x + 1000, y); });
  EXPECT_TRUE(still_.watch(whole.level(kPyramidLevels - 1)));
  EXPECT_LT(still_cells(), before / 2);
}

TEST_F(StillRegionsTest, OfWhatIsMaskedThereAreNoCornersAndTheSmallImageDoesNotHoldOn) {
  const auto circle = [](double scene, int x, int y) { return in_circle(x, y, kRadius) ? scene : 8.0; };
  look(40, {3, 2}, circle);
  ASSERT_TRUE(still_.mask());
  const auto frame_at = [&](int aside, const StillMaskPtr& mask, FrameImages* frame) {
    GrayImage image(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x)
        image.row(y)[x] =
            static_cast<uint8_t>(std::clamp(std::lround(circle(scene(x + aside, y), x, y)), 0L, 255L));
    }
    frame->build_pyramid(image.view(), mask);
    frame->build_tiny();
  };
  FrameImages previous;
  FrameImages now;
  frame_at(500, still_.mask(), &previous);
  frame_at(516, still_.mask(), &now);
  EXPECT_NEAR(align_tiny(previous.tiny, now.tiny).shift.x(), -1, 0.2);
  for (int level = 0; level < kPyramidLevels; ++level) {
    for (const Corner& c : now.corners(level).corners)
      EXPECT_TRUE(in_circle(c.x << level, c.y << level, kRadius)) << "level " << level;
  }
}

}  // namespace
}  // namespace cairn
