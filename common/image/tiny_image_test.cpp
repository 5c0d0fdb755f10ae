// SPDX-License-Identifier: Apache-2.0
#include "common/image/tiny_image.h"

#include <gtest/gtest.h>

#include "common/image/pyramid.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;
using test::Waves;

constexpr int kWidth = 80;  // level 3 of 640x480
constexpr int kHeight = 60;

/// Level-3 pixel to tiny pixel.
Eigen::Vector2d tiny_pixel(int x, int y) {
  return {to_level(static_cast<float>(x), 1), to_level(static_cast<float>(y), 1)};
}

TEST(TinyImageTest, IsTheZeroMeanConvolution) {
  std::mt19937 rng(1);
  for (const float sigma : {0.75F, 2.5F}) {
    const TightImage level3 = TightImage::noise(41, 27, 60, &rng);  // odd row and column drop
    const TinyImage tiny(level3.view(), sigma);
    ASSERT_EQ(tiny.width(), 20);
    ASSERT_EQ(tiny.height(), 13);
    const int radius = static_cast<int>(std::ceil(3 * sigma));
    Eigen::MatrixXd expected(13, 20);
    for (int y = 0; y < 13; ++y) {
      for (int x = 0; x < 20; ++x) {
        double sum = 0;
        double weights = 0;
        for (int j = -radius; j <= radius; ++j) {
          for (int i = -radius; i <= radius; ++i) {
            const int u = 2 * std::clamp(x + i, 0, 19);
            const int v = 2 * std::clamp(y + j, 0, 12);
            const GrayView p = level3.view();
            const double mean = (p.at(u, v) + p.at(u + 1, v) + p.at(u, v + 1) + p.at(u + 1, v + 1)) / 4.0;
            const double weight = std::exp(-0.5 * (i * i + j * j) / (sigma * sigma));
            sum += weight * mean;
            weights += weight;
          }
        }
        expected(y, x) = sum / weights;
      }
    }
    expected.array() -= expected.mean();
    for (int y = 0; y < 13; ++y) {
      for (int x = 0; x < 20; ++x)
        EXPECT_NEAR(tiny.at(x, y), expected(y, x), 1e-3) << sigma << ' ' << x << ' ' << y;
    }
  }
}

TEST(TinyImageTest, AssignReusesMemoryAndForgetsTheLastImage) {
  std::mt19937 rng(2);
  const TightImage first = TightImage::noise(kWidth, kHeight, 60, &rng);
  const TightImage second = TightImage::noise(kWidth, kHeight, 60, &rng);
  TinyImage tiny(first.view(), 2.5F);
  const float* memory = tiny.values().data();
  tiny.assign(second.view(), 2.5F);
  EXPECT_EQ(tiny.values().data(), memory);
  EXPECT_EQ(tiny.values(), TinyImage(second.view(), 2.5F).values());
}

TEST(TinyImageTest, NothingFromNothing) {
  EXPECT_TRUE(TinyImage(GrayView{}, 2.5F).empty());
  EXPECT_TRUE(TinyImage(TightImage(1, 1).view(), 2.5F).empty());
  EXPECT_EQ(TinyImage(TightImage(2, 2).view(), 2.5F).values().size(), 1U);
}

TEST(TinyDifferenceTest, IsAMeanSquare) {
  std::mt19937 rng(3);
  for (const int width : {8, 22, 80}) {
    const TinyImage a(TightImage::noise(width, 14, 60, &rng).view(), 0.75F);
    const TinyImage b(TightImage::noise(width, 14, 60, &rng).view(), 0.75F);
    double sum = 0;
    for (size_t i = 0; i < a.values().size(); ++i) {
      const double d = static_cast<double>(a.values()[i]) - b.values()[i];
      sum += d * d;
    }
    const double expected = sum / static_cast<double>(a.values().size());
    EXPECT_NEAR(tiny_difference(a, b), expected, 1e-5 * expected);
    EXPECT_EQ(tiny_difference(a, b), tiny_difference(b, a));
    EXPECT_EQ(tiny_difference(a, a), 0);
  }
  EXPECT_TRUE(std::isinf(tiny_difference(TinyImage(), TinyImage())));
  EXPECT_TRUE(std::isinf(
      tiny_difference(TinyImage(TightImage(8, 8).view(), 1), TinyImage(TightImage(8, 10).view(), 1))));
}

/// Reference and current image of a texture where a reference pixel p appears at center + R(angle) (p -
/// center) + shift.
struct MovedPair {
  TinyImage reference;
  TinyImage current;
};
MovedPair moved_pair(uint32_t seed, const Eigen::Vector2d& shift, double angle, double brighter = 0) {
  const Waves<2> texture(seed, 0.6);
  const Eigen::Vector2d center(0.5 * (kWidth / 2 - 1), 0.5 * (kHeight / 2 - 1));
  const auto reference = [&](int x, int y) { return 20 + 0.75 * texture(tiny_pixel(x, y)); };
  const auto current = [&](int x, int y) {
    const Eigen::Vector2d p = Eigen::Rotation2Dd(-angle) * (tiny_pixel(x, y) - shift - center) + center;
    return 20 + 0.75 * texture(p) + brighter;
  };
  return {TinyImage(test::render(kWidth, kHeight, reference), 0.75F),
          TinyImage(test::render(kWidth, kHeight, current), 0.75F)};
}

TEST(AlignTinyTest, FindsTheMotionItIsDefinedBy) {
  std::mt19937 rng(4);
  std::uniform_real_distribution<double> any_shift(-1.5, 1.5);
  std::uniform_real_distribution<double> any_angle(-0.06, 0.06);
  for (uint32_t seed = 0; seed < 60; ++seed) {
    const Eigen::Vector2d shift(any_shift(rng), any_shift(rng));
    const double angle = any_angle(rng);
    const MovedPair pair = moved_pair(seed, shift, angle, 6);
    const TinyMotion motion = align_tiny(pair.reference, pair.current, 10);
    EXPECT_LT((motion.shift.cast<double>() - shift).norm(), 0.06)
        << "seed " << seed << ": " << motion.shift.transpose() << " is not " << shift.transpose();
    EXPECT_NEAR(motion.angle, angle, 0.004) << "seed " << seed;
    EXPECT_LT(motion.score, 0.1F * tiny_difference(pair.reference, pair.current) + 0.5F) << "seed " << seed;
  }
}

/// Aligned by the best motion, strangers agree by chance, too: of an image of a few waves by 0.7.
TEST(TinyCorrelationTest, TheSameViewInOtherLightIsMoreAlikeThanAnyOther) {
  for (uint32_t seed = 0; seed < 30; ++seed) {
    const MovedPair pair = moved_pair(seed, {1.2, -0.7}, 0.03, 25);
    const TinyMotion motion = align_tiny(pair.reference, pair.current);
    EXPECT_GT(tiny_correlation(pair.reference, pair.current, motion), 0.9F) << "seed " << seed;
    const TinyImage other = moved_pair(seed + 1000, {0, 0}, 0).current;
    const TinyMotion by_chance = align_tiny(pair.reference, other);
    EXPECT_LT(tiny_correlation(pair.reference, other, by_chance), 0.8F) << "seed " << seed;
  }
}

TEST(TinyCorrelationTest, WhatShowsNothingIsLikeNothing) {
  const TinyImage blank(TightImage(16, 12).view(), 0.75F);
  EXPECT_EQ(tiny_correlation(blank, blank, align_tiny(blank, blank)), -1);
  EXPECT_EQ(tiny_correlation(TinyImage(), blank, align_tiny(TinyImage(), blank)), -1);
}

TEST(AlignTinyTest, SwappingTheImagesInvertsTheMotion) {
  const MovedPair pair = moved_pair(5, {1.2, -0.7}, 0.05);
  const TinyMotion forth = align_tiny(pair.reference, pair.current, 10);
  const TinyMotion back = align_tiny(pair.current, pair.reference, 10);
  EXPECT_NEAR(forth.angle, -back.angle, 2e-3);
  EXPECT_LT((Eigen::Rotation2Df(back.angle) * forth.shift + back.shift).norm(), 0.03);
}

TEST(AlignTinyTest, SameImageRests) {
  const MovedPair pair = moved_pair(6, {0, 0}, 0);
  const TinyMotion motion = align_tiny(pair.reference, pair.reference);
  EXPECT_EQ(motion.shift, Eigen::Vector2f::Zero());
  EXPECT_EQ(motion.angle, 0);
  EXPECT_EQ(motion.score, 0);
}

TEST(AlignTinyTest, BlankImagesRestAndStrangersFail) {
  const TinyImage blank(test::render(kWidth, kHeight, [](int, int) { return 77; }), 0.75F);
  const TinyMotion rest = align_tiny(blank, blank);
  EXPECT_EQ(rest.shift, Eigen::Vector2f::Zero());
  EXPECT_EQ(rest.score, 0);
  const TinyImage other(test::render(kWidth, kHeight + 2, [](int, int) { return 77; }), 0.75F);
  EXPECT_TRUE(std::isinf(align_tiny(blank, other).score));
  EXPECT_TRUE(std::isinf(align_tiny(TinyImage(), TinyImage()).score));
  EXPECT_TRUE(std::isinf(
      align_tiny(TinyImage(TightImage(8, 4).view(), 1), TinyImage(TightImage(8, 4).view(), 1)).score));
}

TEST(AlignTinyTest, NeverReturnsWhatIsNotFinite) {
  std::mt19937 rng(7);
  for (int trial = 0; trial < 100; ++trial) {
    const TinyImage a(TightImage::noise(kWidth, kHeight, 200, &rng).view(), 0.75F);
    const TinyImage b(TightImage::noise(kWidth, kHeight, 200, &rng).view(), 0.75F);
    const TinyMotion motion = align_tiny(a, b);
    EXPECT_TRUE(motion.shift.allFinite() && std::isfinite(motion.angle)) << "trial " << trial;
    if (std::isinf(motion.score)) {
      EXPECT_EQ(motion.shift, Eigen::Vector2f::Zero()) << "trial " << trial;
    }
  }
}

CameraPtr test_camera(int width = 640, int height = 480) {
  const auto camera =
      make_camera({.model = CameraModel::kPinholeRadtan,
                   .width = width,
                   .height = height,
                   .values = {525, 525, 0.5 * (width - 1), 0.5 * (height - 1), -0.05, 0.01, 0, 0, 0}});
  EXPECT_TRUE(camera.has_value());
  return camera.value();
}

/// What a camera with that orientation sees of a textured sphere of infinite radius.
TinyImage view_of_sphere(const Waves<3>& sphere, const Camera& camera, const SE3& camera_from_world) {
  const SE3 world_from_camera = camera_from_world.inverse();
  return {test::render(kWidth, kHeight,
                       [&](int x, int y) {
                         const Eigen::Vector2d pixel(from_level(static_cast<float>(x), 3),
                                                     from_level(static_cast<float>(y), 3));
                         return sphere(world_from_camera * camera.unproject(pixel));
                       }),
          0.75F};
}

TEST(RotationFromTinyTest, IsTheRotationOfTheCamera) {
  const CameraPtr camera = test_camera();
  std::mt19937 rng(8);
  std::uniform_real_distribution<double> any(-0.03, 0.03);
  for (uint32_t seed = 0; seed < 40; ++seed) {
    const Waves<3> sphere(seed, 18);
    Eigen::Vector3d omega;  // drawn one after the other: compilers differ in the order of arguments
    for (const int axis : {2, 1, 0}) omega[axis] = any(rng);
    const SE3 current_from_reference(so3_exp(omega), Eigen::Vector3d::Zero());
    const TinyImage reference = view_of_sphere(sphere, *camera, SE3());
    const TinyImage current = view_of_sphere(sphere, *camera, current_from_reference);
    const TinyMotion motion = align_tiny(reference, current, 10);
    const SE3 estimate = rotation_from_tiny(motion, *camera, reference.width());
    const double error = so3_log(estimate.rotation() * current_from_reference.rotation().conjugate()).norm();
    EXPECT_LT(error, 0.004) << "seed " << seed << ", rotation " << omega.transpose() << ", found "
                            << so3_log(estimate.rotation()).transpose();
    EXPECT_EQ(estimate.translation(), Eigen::Vector3d::Zero());
  }
}

TEST(RotationFromTinyTest, TakesTheReferenceCentreToWhereItMoved) {
  // 650x490: levels drop odd rows and columns, and the scale stays 16.
  for (const auto& [width, height, tiny_width] : {std::tuple{640, 480, 40}, {650, 490, 40}, {384, 288, 24}}) {
    const CameraPtr camera = test_camera(width, height);
    const TinyMotion motion{.shift = {2.5F, -1.5F}, .angle = 0, .score = 0};
    const SE3 rotation = rotation_from_tiny(motion, *camera, tiny_width);
    const Eigen::Vector2d center((width / 16 - 1) / 2.0, (height / 16 - 1) / 2.0);
    const auto ray = [&](const Eigen::Vector2d& tiny) {
      return camera->unproject({16 * (tiny.x() + 0.5) - 0.5, 16 * (tiny.y() + 0.5) - 0.5});
    };
    const Eigen::Vector3d moved = ray(center + Eigen::Vector2d(2.5, -1.5));
    EXPECT_LT((rotation * ray(center) - moved).norm(), 2e-3) << width;
  }
}

TEST(RotationFromTinyTest, NoMotionIsTheIdentity) {
  const SE3 rotation = rotation_from_tiny(TinyMotion{}, *test_camera(), 40);
  EXPECT_LT(so3_log(rotation.rotation()).norm(), 1e-12);
}

}  // namespace
}  // namespace cairn
