// SPDX-License-Identifier: Apache-2.0
#include "common/image/patch.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "common/image/fit_warp.h"
#include "common/image/kernels.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;
using test::Waves;

Warp random_warp(std::mt19937* rng, float spread) {
  std::uniform_real_distribution<float> turn(-3.2F, 3.2F);
  std::uniform_real_distribution<float> other(-spread, spread);
  Warp warp;
  warp << 1 + other(*rng), other(*rng), other(*rng), 1 + other(*rng);
  return Eigen::Rotation2Df(turn(*rng)).toRotationMatrix() * warp;
}

SourcePatch patch_at(const GrayView& image, int x, int y) {
  SourcePatch patch{};
  EXPECT_TRUE(cut_source_patch(image, {static_cast<int16_t>(x), static_cast<int16_t>(y)}, &patch));
  return patch;
}

/// Template of what surrounds a pixel, unwarped.
PatchTemplate template_at(const GrayView& image, int x, int y) {
  PatchTemplate patch;
  EXPECT_TRUE(make_template(patch_at(image, x, y), Warp::Identity(), 0, &patch));
  return patch;
}

TEST(SourcePatchTest, HoldsTheNeighbourhoodAndRefusesTheBorder) {
  std::mt19937 rng(1);
  const TightImage image = TightImage::noise(60, 50, 80, &rng);
  SourcePatch patch{};
  for (int y = 0; y < 50; ++y) {
    for (int x = 0; x < 60; ++x) {
      const bool fits = x >= 12 && y >= 12 && x + 11 < 60 && y + 11 < 50;
      ASSERT_EQ(cut_source_patch(image.view(), {static_cast<int16_t>(x), static_cast<int16_t>(y)}, &patch),
                fits);
      if (fits) {
        ASSERT_EQ(patch[12 * 24 + 12], image.view().at(x, y));
      }
      if (fits) {
        ASSERT_EQ(patch[3 * 24 + 20], image.view().at(x + 8, y - 9));
      }
    }
  }
}

TEST(WarpLevelTest, IsTheLowestLevelWithAnAreaOfAtMostThree) {
  for (float scale = 0.3F; scale < 20; scale *= 1.07F) {
    const Warp warp = scale * Eigen::Rotation2Df(scale).toRotationMatrix();
    const std::optional<int> level = warp_level(warp);
    const float area = scale * scale;
    if (area <= 0.25F || area > 3.0F * 64) {
      EXPECT_FALSE(level) << scale;
      continue;
    }
    ASSERT_TRUE(level) << scale;
    EXPECT_LT(area / std::pow(4.0F, static_cast<float>(*level)), 3.0F) << scale;
    if (*level > 0) {
      EXPECT_GE(area / std::pow(4.0F, static_cast<float>(*level - 1)), 3.0F) << scale;
    }
  }
  EXPECT_FALSE(warp_level(Warp::Zero()));
  EXPECT_FALSE(
      warp_level(Eigen::DiagonalMatrix<float, 2>(-1, 1).toDenseMatrix()));  // mirrored: seen from behind
  EXPECT_FALSE(warp_level(Warp::Constant(std::nanf(""))));
}

TEST(TemplateTest, IdentityCopiesThePixels) {
  std::mt19937 rng(2);
  const TightImage image = TightImage::noise(40, 40, 90, &rng);
  const GrayView v = image.view();
  const PatchTemplate patch = template_at(v, 20, 19);
  int sum = 0;
  int sum_squares = 0;
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) {
      const auto k = static_cast<size_t>(j * 8 + i);
      const int x = 20 + i - 4;
      const int y = 19 + j - 4;
      EXPECT_EQ(patch.pixels[k], v.at(x, y));
      EXPECT_EQ(patch.gradient_x[k], v.at(x + 1, y) - v.at(x - 1, y));
      EXPECT_EQ(patch.gradient_y[k], v.at(x, y + 1) - v.at(x, y - 1));
      sum += v.at(x, y);
      sum_squares += v.at(x, y) * v.at(x, y);
    }
  }
  EXPECT_EQ(patch.sum, sum);
  EXPECT_EQ(patch.sum_squares, sum_squares);
  EXPECT_EQ(zmssd_at(patch, v, 20, 19), 0);
}

TEST(TemplateTest, QuarterTurnPermutesThePixels) {
  std::mt19937 rng(3);
  const TightImage image = TightImage::noise(24, 24, 90, &rng);
  const SourcePatch source = patch_at(image.view(), 12, 12);
  Warp quarter;  // source (dx, dy) appears at (-dy, dx)
  quarter << 0, -1, 1, 0;
  PatchTemplate patch;
  ASSERT_TRUE(make_template(source, 8 * quarter, 3, &patch));
  EXPECT_EQ(patch.level, 3);
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) {
      const int dx = j - 4;
      const int dy = -(i - 4);
      EXPECT_EQ(patch.pixels[static_cast<size_t>(j * 8 + i)],
                source[static_cast<size_t>((12 + dy) * 24 + 12 + dx)]);
    }
  }
}

TEST(TemplateTest, SamplesTheSourceWhereTheWarpSays) {
  std::mt19937 rng(4);
  for (uint32_t seed = 0; seed < 50; ++seed) {
    const Waves<2> texture(seed, 0.25);
    const GrayImage image = test::render(24, 24, [&](int x, int y) { return texture({x, y}); });
    const Warp warp = random_warp(&rng, 0.2F);
    PatchTemplate patch;
    ASSERT_TRUE(make_template(patch_at(image, 12, 12), warp, 0, &patch));
    for (int j = 0; j < 8; ++j) {
      for (int i = 0; i < 8; ++i) {
        const Eigen::Vector2d at =
            Eigen::Vector2d(12, 12) + warp.cast<double>().inverse() * Eigen::Vector2d(i - 4, j - 4);
        ASSERT_NEAR(patch.pixels[static_cast<size_t>(j * 8 + i)], texture(at), 3.0) << "seed " << seed;
      }
    }
  }
}

TEST(TemplateTest, VariantsAgreeOnEveryWarp) {
  std::mt19937 rng(5);
  int made = 0;
  int refused = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const TightImage image = TightImage::noise(24, 24, 60, &rng);
    const SourcePatch source = patch_at(image.view(), 12, 12);
    const int level = trial % 4;
    const Warp warp = random_warp(&rng, 0.7F) * static_cast<float>(1 << level);
    PatchTemplate expected;
    const bool ok = kernels::make_template(source, warp, level, &expected, Simd::kScalar);
    (ok ? made : refused) += 1;
    for (const Simd simd : test::simd_variants()) {
      PatchTemplate patch;
      ASSERT_EQ(kernels::make_template(source, warp, level, &patch, simd), ok);
      if (!ok) continue;
      ASSERT_EQ(patch.pixels, expected.pixels) << "trial " << trial;
      ASSERT_EQ(patch.gradient_x, expected.gradient_x) << "trial " << trial;
      ASSERT_EQ(patch.gradient_y, expected.gradient_y) << "trial " << trial;
      ASSERT_EQ(patch.inverse_hessian, expected.inverse_hessian) << "trial " << trial;
    }
  }
  EXPECT_GT(made, 500);
  EXPECT_GT(refused, 50);
}

TEST(TemplateTest, RefusesWarpsThatCannotBeSampled) {
  const SourcePatch source{};
  PatchTemplate patch;
  EXPECT_FALSE(make_template(source, Warp::Zero(), 0, &patch));
  EXPECT_FALSE(make_template(source, Warp::Constant(std::nanf("")), 0, &patch));
  EXPECT_FALSE(make_template(source, 1e-20F * Warp::Identity(), 0, &patch));
  EXPECT_FALSE(make_template(source, 0.33F * Warp::Identity(), 0, &patch));
  EXPECT_TRUE(make_template(source, 0.35F * Warp::Identity(), 0, &patch));
}

TEST(TemplateTest, InverseHessianInverts) {
  std::mt19937 rng(6);
  const TightImage image = TightImage::noise(40, 40, 60, &rng);
  const PatchTemplate patch = template_at(image.view(), 20, 20);
  ASSERT_FALSE(patch.flat);
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  for (size_t k = 0; k < 64; ++k) {
    const Eigen::Vector3d j(0.5 * patch.gradient_x[k], 0.5 * patch.gradient_y[k], 1);
    hessian += j * j.transpose();
  }
  const Eigen::Matrix3d product = hessian * patch.inverse_hessian.cast<double>();
  EXPECT_LT((product - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-4) << product;
}

TEST(TemplateTest, BlankAndEdgeAreFlat) {
  const GrayImage blank = test::render(40, 40, [](int, int) { return 90; });
  const GrayImage edge =
      test::render(40, 40, [](int x, int y) { return std::clamp(100 + 10 * (x + y - 40), 0, 255); });
  const GrayImage corner = test::render(40, 40, [](int x, int y) { return x > 19 && y > 19 ? 200 : 60; });
  EXPECT_TRUE(template_at(blank, 20, 20).flat);
  EXPECT_TRUE(template_at(edge, 20, 20).flat);
  EXPECT_FALSE(template_at(corner, 20, 20).flat);
  EXPECT_FALSE(refine_patch(template_at(edge, 20, 20), edge, {20, 20}));
}

TEST(ZmssdTest, EveryVariantIsTheRoundedExactValue) {
  std::mt19937 rng(7);
  for (const int step : {3, 60, 255}) {
    const TightImage image = TightImage::noise(50, 40, step, &rng);
    const PatchTemplate patch = template_at(image.view(), 20, 20);
    for (int y = 4; y <= 36; ++y) {
      for (int x = 4; x <= 46; ++x) {
        int64_t squares = 0;
        int64_t sum = 0;
        for (int j = 0; j < 8; ++j) {
          for (int i = 0; i < 8; ++i) {
            const int d =
                patch.pixels[static_cast<size_t>(j * 8 + i)] - image.view().at(x + i - 4, y + j - 4);
            squares += d * d;
            sum += d;
          }
        }
        const auto expected = static_cast<int>((64 * squares - sum * sum) / 64);
        for (const Simd simd : test::simd_variants()) {
          ASSERT_EQ(kernels::zmssd_at(patch, image.view(), x, y, simd), expected) << x << ' ' << y;
        }
      }
    }
  }
}

TEST(ZmssdTest, ExtremesDoNotOverflow) {
  const GrayImage black = test::render(24, 24, [](int, int) { return 0; });
  const GrayImage white = test::render(24, 24, [](int, int) { return 255; });
  const GrayImage halves = test::render(24, 24, [](int, int y) { return y < 12 ? 0 : 255; });
  const GrayImage flipped = test::render(24, 24, [](int, int y) { return y < 12 ? 255 : 0; });
  for (const Simd simd : test::simd_variants()) {
    EXPECT_EQ(kernels::zmssd_at(template_at(black, 12, 12), white, 12, 12, simd), 0);
    EXPECT_EQ(kernels::zmssd_at(template_at(white, 12, 12), black, 12, 12, simd), 0);
    EXPECT_EQ(kernels::zmssd_at(template_at(halves, 12, 12), flipped, 12, 12, simd), 64 * 255 * 255);
  }
}

TEST(FindPatchTest, EveryVariantFindsTheBestCornerInTheCircle) {
  std::mt19937 rng(8);
  std::uniform_real_distribution<float> any_x(-10, 130);
  std::uniform_real_distribution<float> any_y(-10, 70);
  std::uniform_real_distribution<float> any_radius(0, 40);
  const TightImage image = TightImage::noise(120, 60, 45, &rng);
  const GrayView v = image.view();
  CornerList corners;
  detect_fast10(v, 10, &corners);
  ASSERT_GT(corners.corners.size(), 200U);
  int found = 0;
  for (int trial = 0; trial < 500; ++trial) {
    const PatchTemplate patch = template_at(v, 12 + trial % 90, 12 + trial % 35);
    const Eigen::Vector2f center(any_x(rng), any_y(rng));
    const float radius = any_radius(rng);
    const int limit = trial % 2 == 0 ? kMaxZmssd : 64 * 3000;
    std::optional<PatchMatch> expected;
    for (const Corner c : corners.corners) {
      const Eigen::Vector2f offset = Eigen::Vector2f(c.x, c.y) - center;
      if (offset.squaredNorm() > radius * radius) continue;
      if (c.x < 4 || c.y < 4 || c.x > 116 || c.y > 56) continue;
      const int score = zmssd_at(patch, v, c.x, c.y);
      if (score < (expected ? expected->zmssd : limit)) expected = PatchMatch{c, score};
    }
    found += expected ? 1 : 0;
    for (const Simd simd : test::simd_variants()) {
      const auto match = kernels::find_patch(patch, v, corners, center, radius, limit, simd);
      ASSERT_EQ(match.has_value(), expected.has_value()) << "trial " << trial;
      if (!match) continue;
      ASSERT_EQ(match->corner, expected->corner) << "trial " << trial;
      ASSERT_EQ(match->zmssd, expected->zmssd) << "trial " << trial;
    }
  }
  EXPECT_GT(found, 100);
  EXPECT_LT(found, 500);
}

TEST(FindPatchTest, NothingFromNothing) {
  const GrayImage blank = test::render(40, 40, [](int, int) { return 90; });
  const PatchTemplate patch = template_at(blank, 20, 20);
  CornerList corners;
  EXPECT_FALSE(find_patch(patch, blank, corners, {20, 20}, 10));  // no table yet
  detect_fast10(blank, 10, &corners);
  EXPECT_FALSE(find_patch(patch, blank, corners, {20, 20}, 10));
  EXPECT_FALSE(find_patch(patch, blank, corners, {std::nanf(""), 20}, 10));
  EXPECT_FALSE(find_patch(patch, blank, corners, {20, std::nanf("")}, 10));
  EXPECT_FALSE(find_patch(patch, blank, corners, {20, 1e30F}, 10));
}

/// An image and one of the same texture moved by `shift` and brightened.
struct ShiftedPair {
  GrayImage reference;
  GrayImage moved;
};
ShiftedPair shifted_pair(uint32_t seed, const Eigen::Vector2d& shift, double brighter) {
  const Waves<2> texture(seed, 0.7);
  const auto dimmed = [&](const Eigen::Vector2d& p) { return 20 + 0.8 * texture(p); };
  return {
      test::render(48, 48,
                   [&](int x, int y) {
                     return dimmed({x, y});
                   }),
      test::render(48, 48, [&](int x, int y) { return dimmed(Eigen::Vector2d(x, y) - shift) + brighter; })};
}

TEST(RefinePatchTest, RecoversSubPixelShifts) {
  constexpr int kTrials = 400;
  std::mt19937 rng(9);
  std::uniform_real_distribution<double> any(-0.7, 0.7);
  double error_sum = 0;
  int refined = 0;
  for (uint32_t trial = 0; trial < kTrials; ++trial) {
    const Eigen::Vector2d shift(any(rng), any(rng));
    const ShiftedPair pair = shifted_pair(trial, shift, 9);
    const PatchTemplate patch = template_at(pair.reference, 24, 24);
    if (patch.flat) continue;
    const std::optional<Eigen::Vector2f> position = refine_patch(patch, pair.moved, {24, 24});
    if (!position) continue;
    ++refined;
    const double error = (position->cast<double>() - Eigen::Vector2d(24, 24) - shift).norm();
    EXPECT_LT(error, 0.2) << "seed " << trial;
    error_sum += error;
  }
  EXPECT_GE(refined, kTrials * 95 / 100);
  EXPECT_LT(error_sum / refined, 0.02);
}

TEST(RefinePatchTest, VariantsAgreeToTheBit) {
  std::mt19937 rng(10);
  std::uniform_real_distribution<float> any(4, 44);
  int refined = 0;
  for (uint32_t trial = 0; trial < 500; ++trial) {
    const ShiftedPair pair = shifted_pair(trial % 20, {0.3, -0.4}, 0);
    const PatchTemplate patch = template_at(pair.reference, 24, 24);
    const Eigen::Vector2f start =
        trial % 2 == 0 ? Eigen::Vector2f(24 + any(rng) / 30, 24) : Eigen::Vector2f(any(rng), any(rng));
    const auto expected = kernels::refine_patch(patch, pair.moved, start, 10, 3, 64 * 5000, Simd::kScalar);
    refined += expected ? 1 : 0;
    for (const Simd simd : test::simd_variants()) {
      const auto position = kernels::refine_patch(patch, pair.moved, start, 10, 3, 64 * 5000, simd);
      ASSERT_EQ(position, expected) << "trial " << trial << ", variant " << static_cast<int>(simd);
    }
  }
  EXPECT_GT(refined, 150);
}

TEST(RefinePatchTest, RefusesWhatItCannotVouchFor) {
  const ShiftedPair pair = shifted_pair(1, {2.4, 0.3}, 0);
  const PatchTemplate patch = template_at(pair.reference, 24, 24);
  ASSERT_TRUE(refine_patch(patch, pair.moved, {26, 24}));
  EXPECT_FALSE(refine_patch(patch, pair.moved, {26, 24}, 0)) << "no iteration, no convergence";
  EXPECT_FALSE(refine_patch(patch, pair.moved, {25, 24}, 20, 0.5F)) << "moved further than allowed";
  EXPECT_FALSE(refine_patch(patch, pair.moved, {26, 24}, 10, 3, 0)) << "differs more than allowed";
  EXPECT_FALSE(refine_patch(patch, pair.moved, {2, 24})) << "outside";
  EXPECT_FALSE(refine_patch(patch, pair.moved, {24, 46})) << "outside";
  EXPECT_FALSE(refine_patch(patch, pair.moved, {std::nanf(""), 24}));
  EXPECT_FALSE(refine_patch(patch, pair.moved, {1e30F, 24}));
}

TEST(RefinePatchTest, ReadsNoPixelOutside) {
  // AddressSanitizer judges: every start, in an image with nothing around it.
  std::mt19937 rng(11);
  const TightImage image = TightImage::noise(28, 28, 30, &rng);
  const PatchTemplate patch = template_at(image.view(), 14, 14);
  int inside = 0;
  for (float y = -2; y < 30; y += 0.37F) {
    for (float x = -2; x < 30; x += 0.37F) {
      inside += refine_patch(patch, image.view(), {x, y}, 5, 30, 64 * 65025).has_value() ? 1 : 0;
    }
  }
  EXPECT_GT(inside, 0);
}

TEST(SampleBilinearTest, IsExactOnAPlane) {
  const GrayImage plane = test::render(30, 30, [](int x, int y) { return 3 * x + 4 * y; });
  for (float y = 0; y < 29; y += 0.31F) {
    for (float x = 0; x < 29; x += 0.17F) EXPECT_NEAR(sample_bilinear(plane, x, y), 3 * x + 4 * y, 1e-4);
  }
}

/// Where the pixels of a grid go under a linear map.
std::vector<PixelMatch> moved_by(const Warp& warp) {
  std::vector<PixelMatch> matches;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector2d a(17 * (i % 8), 23 * (i / 8));
    matches.push_back({a, warp.cast<double>() * a + Eigen::Vector2d(30, -20)});
  }
  return matches;
}

TEST(FitWarpTest, IsTheMapOfTheMatchesIfATemplateCanHaveIt) {
  std::mt19937 rng(13);
  for (int i = 0; i < 200; ++i) {
    const Warp warp = random_warp(&rng, 1.5F);
    const Warp expected = warp_level(warp) ? warp : Warp::Identity();
    EXPECT_LT((fit_warp(moved_by(warp)) - expected).norm(), 1e-4F) << warp;
  }
  EXPECT_EQ(fit_warp(moved_by(0.1F * Warp::Identity())), Warp::Identity()) << "too small for a template";
}

}  // namespace
}  // namespace cairn
