// SPDX-License-Identifier: Apache-2.0
//
// One number for what all kernels make of an image. Each has its own test against the scalar reference; this
// one says that all processors agree, since the number is written down: x86-64 with and without AVX2 and
// AVX-512, ARM64.
#include <gtest/gtest.h>

#include "common/image/kernels.h"
#include "common/image/pyramid.h"
#include "common/image/test_textures.h"
#include "common/image/tiny_image.h"

namespace cairn {
namespace {

using test::Hash;

constexpr int kWidth = 322;  // no multiple of any vector
constexpr int kHeight = 245;

void add(const GrayView& image, Hash* hash) {
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) hash->add(image.row(y)[x]);
  }
}

void add(const PatchTemplate& patch, Hash* hash) {
  hash->add(patch.pixels);
  hash->add(patch.gradient_x);
  hash->add(patch.gradient_y);
  hash->add(patch.sum);
  hash->add(patch.sum_squares);
  for (const float value : patch.inverse_hessian.reshaped()) hash->add(value);
}

void add(const PatchMatch& match, Hash* hash) {
  hash->add(match.corner.x);
  hash->add(match.corner.y);
  hash->add(match.zmssd);
}

/// Templates of a patch, sharp and smeared, and where they are found again.
void add_patches(const GrayView& image, const CornerList& corners, Corner corner, Simd simd, Hash* hash) {
  SourcePatch source{};
  if (!cut_source_patch(image, corner, &source)) return;
  Warp warp;
  warp << 0.96F, -0.21F, 0.24F, 0.93F;
  PatchTemplate patch;
  PatchTemplate smeared;
  ASSERT_TRUE(kernels::make_smeared_template(source, warp, 0, {4, 3}, {0.3F, 0.2F}, &smeared, simd));
  add(smeared, hash);
  ASSERT_TRUE(kernels::make_template(source, warp, 0, &patch, simd));
  add(patch, hash);
  const Eigen::Vector2f beside(static_cast<float>(corner.x) + 1.6F, static_cast<float>(corner.y) - 1.4F);
  if (const auto match = kernels::find_patch(patch, image, corners, beside, 10, 1 << 20, simd))
    add(*match, hash);
  if (const auto place = kernels::refine_patch(patch, image, beside, 10, 3, 1 << 20, simd)) {
    hash->add(place->x());
    hash->add(place->y());
  }
}

uint64_t hash_of_kernels(Simd simd) {
  Hash hash;
  const GrayImage image = test::integer_image(kWidth, kHeight);
  GrayImage half;
  kernels::halve(image.view(), &half, simd);
  add(half.view(), &hash);
  CornerList corners;
  kernels::detect_fast10(image.view(), 20, &corners, simd);
  size_t count = 0;
  for (const Corner corner : corners.corners) {
    hash.add(corner.x);
    hash.add(corner.y);
    if (++count % 50 == 0) add_patches(image.view(), corners, corner, simd, &hash);
  }
  EXPECT_GT(count, 2000U);
  SourcePatch source{};
  PatchTemplate patch;
  EXPECT_TRUE(cut_source_patch(image.view(), {160, 120}, &source) &&
              kernels::make_template(source, Warp::Identity(), 0, &patch, simd));
  int limit = 1 << 20;
  std::vector<PatchMatch> matches;
  const std::vector<PixelRun> runs = {{100, 8, 313}, {120, 20, 310}, {140, 4, 318}};
  kernels::search_zmssd(patch, image.view(), BoxSums(image.view()), runs, 0.7F, &limit, &matches, simd);
  for (const PatchMatch& match : matches) add(match, &hash);
  return hash.value;
}

TEST(LockstepTest, KernelsAgreeOnEveryProcessor) {
  for (const Simd simd : test::simd_variants())
    EXPECT_EQ(hash_of_kernels(simd), 0xDC6044EACA46D824ULL) << "variant " << static_cast<int>(simd);
}

/// Four lanes on every machine, in single precision, and Eigen's solver.
TEST(LockstepTest, AlignmentAgreesOnEveryProcessor) {
  const GrayImage here = test::integer_image(80, 60);
  GrayImage there(80, 60);
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 80; ++x) there.row(y)[x] = here.row(std::min(y + 1, 59))[std::max(x - 1, 0)];
  }
  const TinyMotion motion = align_tiny(TinyImage(here.view(), 2.5F), TinyImage(there.view(), 2.5F), 10);
  Hash hash;
  hash.add(motion.shift.x());
  hash.add(motion.shift.y());
  hash.add(motion.angle);
  hash.add(motion.score);
  EXPECT_EQ(hash.value, 0x7435D89C67DDA02AULL)
      << motion.shift.transpose() << ", " << motion.angle << ", " << motion.score;
}

}  // namespace
}  // namespace cairn
