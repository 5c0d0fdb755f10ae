// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/exposure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr double kFrameTime = 1.0 / 30;  // [s]
constexpr int kWidth = 320;
constexpr int kHeight = 48;

/// A texture with points all over it, seen by a camera that exposes for a share of the time between two
/// frames.
class Film {
 public:
  explicit Film(double share) : share_(share) {
    const GrayImage sharp = render(0);
    auto patches = std::make_shared<PatchBlock>();
    for (int x = 32; x < kWidth - 32; x += 8) {
      VisiblePoint point;
      point.found = true;
      point.slot = {0, static_cast<int>(patches->points.size())};
      point.expected = Eigen::Vector2i(x, kHeight / 2).cast<float>();
      PointSource& source = patches->points.emplace_back();
      EXPECT_TRUE(cut_source_patch(sharp.view(), {static_cast<int16_t>(x), kHeight / 2}, &source.pixels));
      points_.push_back(point);
    }
    auto block = std::make_shared<PointBlock>();
    block->patches = patches;
    map_.point_blocks = {block};
  }

  /// The next frame; by so many pixels the image has moved since the one before.
  void play(float way, Exposure* exposure) {
    TinyMotion motion;
    motion.shift.x() = way / (1 << kPyramidLevels);
    frame_.build_pyramid(render(share_ * static_cast<double>(way)).view());
    exposure->next_frame(motion, kFrameTime, &frame_);
    for (VisiblePoint& p : points_) p.pixel = p.expected;
    exposure->learn(frame_, points_, map_);
  }
  [[nodiscard]] Eigen::Vector2f smear() const { return frame_.smear.at({0, 0}); }

 private:
  [[nodiscard]] GrayImage render(double smear) const {
    const auto reach = static_cast<int>(std::lround(smear * kFine / 2));
    return test::render(kWidth, kHeight, [&](int x, int y) {
      const double* middle = &texture_[static_cast<size_t>(y * kFineWidth + (x + kMargin) * kFine)];
      double sum = 0;
      for (int k = -reach; k <= reach; ++k) sum += middle[k];
      return sum / (2 * reach + 1);
    });
  }
  static std::vector<double> make_texture() {
    const test::Waves<2> waves(4, 1.0, 20);
    std::vector<double> texture;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kFineWidth; ++x)
        texture.push_back(128 + 0.5 * (waves({static_cast<double>(x) / kFine, y}) - 128));
    }
    return texture;
  }
  static constexpr int kFine = 4;     // samples per pixel along the way
  static constexpr int kMargin = 10;  // [px]
  static constexpr int kFineWidth = (kWidth + 2 * kMargin) * kFine;

  double share_;
  std::vector<double> texture_ = make_texture();
  std::vector<VisiblePoint> points_;
  MapSnapshot map_;
  FrameImages frame_;
};

TEST(ExposureTest, IsEstimatedFromTheSmear) {
  for (const double share : {0.0, 0.25, 0.5, 0.9}) {
    Film film(share);
    Exposure exposure{ExposureOptions()};
    for (int i = 0; i < 30; ++i)
      film.play((i % 2 == 0 ? 1.0F : -1.0F) * (3 + 0.2F * static_cast<float>(i)), &exposure);
    EXPECT_NEAR(exposure.seconds(), share * kFrameTime, 0.12 * kFrameTime) << share;
    film.play(8, &exposure);
    EXPECT_NEAR(film.smear().x(), 8 * share, 1) << share;
  }
}

TEST(ExposureTest, WhoHardlyMovesTellsNothing) {
  Film film(0.5);
  Exposure exposure{ExposureOptions()};
  for (int i = 0; i < 20; ++i) film.play(1, &exposure);
  EXPECT_EQ(exposure.seconds(), 0);
}

TEST(ExposureTest, FramesWithoutTimeBetweenThemHaveNoKnownSmear) {
  Exposure exposure{ExposureOptions()};
  FrameImages frame;
  frame.build_pyramid(GrayImage(64, 48).view());
  exposure.next_frame({}, 0, &frame);
  EXPECT_TRUE(frame.smear.is_none());
  exposure.learn(frame, {}, MapSnapshot{});
  EXPECT_EQ(exposure.seconds(), 0);
}

}  // namespace
}  // namespace cairn
