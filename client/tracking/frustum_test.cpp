// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/frustum.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <numbers>
#include <random>

#include "common/image/patch.h"

namespace cairn {
namespace {

constexpr unsigned kSeed = 20;

std::vector<CameraParameters> cameras() {
  return {{CameraModel::kPinholeRadtan, 640, 480, {525, 525, 319.5, 239.5}},
          {CameraModel::kPinholeRadtan, 640, 480, {420, 430, 300, 250, -0.28, 0.07, 0.001, -0.001}},
          {CameraModel::kKannalaBrandt, 640, 480, {300, 300, 320, 240, 0.01, -0.002, 0.001, 0}}};
}

Eigen::Vector3f random_vector(std::mt19937& engine) {
  std::normal_distribution<float> normal;
  return {normal(engine), normal(engine), normal(engine)};
}

/// A block of points around the camera, each seen by keyframes from a side of its own; no patches.
PointBlock random_block(std::mt19937& engine) {
  std::uniform_real_distribution<float> uniform;
  PointBlock block;
  block.count = kBlockSlots;
  block.live = ~uint64_t{0} << 3;
  for (size_t s = 0; s < kBlockSlots; ++s) {
    const Eigen::Vector3f at = random_vector(engine);
    const Eigen::Vector3f view = random_vector(engine).normalized();
    const Eigen::Vector3f span = 1e-6F * random_vector(engine);
    block.x[s] = at.x(), block.y[s] = at.y(), block.z[s] = at.z();
    block.view_x[s] = view.x(), block.view_y[s] = view.y(), block.view_z[s] = view.z();
    block.view_cosine[s] = 2 * uniform(engine) - 1;
    block.view_sine[s] = std::sqrt(1 - block.view_cosine[s] * block.view_cosine[s]);
    block.nearest[s] = 2 * uniform(engine);
    block.farthest[s] = block.nearest[s] + uniform(engine);
    block.span_x[s] = span.x(), block.span_y[s] = span.y(), block.span_z[s] = span.z();
  }
  return block;
}

TEST(Frustum, HoldsWhatProjectsIntoTheImageAndLittleElse) {
  std::mt19937 engine(kSeed);
  for (const CameraParameters& parameters : cameras()) {
    const auto camera = make_camera(parameters).value();
    const Frustum frustum(*camera, FrustumOptions());
    int in_image = 0;
    int held_outside = 0;
    for (int i = 0; i < 20000; ++i) {
      const Eigen::Vector3f p = random_vector(engine);
      const auto pixel = camera->project(p.cast<double>());
      const bool is_in = pixel && p.z() > 0 && camera->in_image(*pixel);
      const bool is_held = frustum.may_hold(p, 0);
      EXPECT_TRUE(is_held || !is_in) << p.transpose();
      in_image += is_in ? 1 : 0;
      held_outside += is_held && !is_in ? 1 : 0;
    }
    EXPECT_GT(in_image, 500);
    EXPECT_LT(held_outside, in_image / 2) << "the fisheye's edges bend most";
  }
}

TEST(Frustum, PassesOverASphereOnlyIfAllOfItIsOutOfView) {
  std::mt19937 engine(kSeed);
  const auto camera = make_camera(cameras()[1]).value();
  const Frustum frustum(*camera, FrustumOptions());
  int passed_over = 0;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3f center = 2 * random_vector(engine);
    const float radius = 0.5F;
    if (frustum.may_hold(center, radius)) continue;
    ++passed_over;
    for (int k = 0; k < 20; ++k)
      EXPECT_FALSE(frustum.may_hold(center + radius * random_vector(engine).normalized(), 0));
  }
  EXPECT_GT(passed_over, 500);
}

/// The vectorized test says what the definitions say, point by point.
TEST(Frustum, BlocksAreJudgedAsTheirPoints) {
  std::mt19937 engine(kSeed);
  const auto camera = make_camera(cameras()[0]).value();
  const Frustum frustum(*camera, FrustumOptions());
  const double extra = 35 * std::numbers::pi / 180;
  int passed = 0;
  for (int i = 0; i < 200; ++i) {
    const PointBlock block = random_block(engine);
    const SE3 camera_from_map{so3_exp(random_vector(engine).cast<double>()),
                              0.3 * random_vector(engine).cast<double>()};
    const BlockView view = view_block(block, frustum, camera_from_map, 525);
    passed += std::popcount(view.slots);
    const BlockView narrow = kernels::view_block(block, frustum, camera_from_map, 525, Simd::kNarrow);
    EXPECT_EQ(narrow.slots, view.slots);
    EXPECT_EQ(narrow.coarse, view.coarse);
    for (size_t s = 0; s < kBlockSlots; ++s) {
      const Eigen::Vector3d at = block.position(static_cast<int>(s));
      const Eigen::Vector3d to_camera = camera_from_map.center() - at;
      const Eigen::Vector3d view_direction(block.view_x[s], block.view_y[s], block.view_z[s]);
      const double angle = std::acos(std::clamp(view_direction.dot(to_camera.normalized()), -1.0, 1.0));
      const double allowed = std::acos(block.view_cosine[s]) + extra;
      const Eigen::Vector3d in_camera = camera_from_map * at;
      // Too near a limit to call in single precision.
      if (std::abs(angle - allowed) < 1e-4 || std::abs(in_camera.z()) < 2e-3) continue;
      const bool is_expected =
          s >= 3 && in_camera.z() > 1e-3 && angle < allowed && frustum.may_hold(in_camera.cast<float>(), 0) &&
          to_camera.norm() > 0.5 * block.nearest[s] && to_camera.norm() < 2 * block.farthest[s];
      EXPECT_EQ((view.slots >> s & 1) != 0, is_expected)
          << "seed " << kSeed << ", block " << i << ", slot " << s;
    }
  }
  EXPECT_GT(passed, 300);
}

/// On a patch near the axis of a pinhole camera the estimate is the determinant of the warp.
TEST(Frustum, CoarsePointsAreThoseOfTheWarpsLevel) {
  const auto camera = make_camera(cameras()[0]).value();
  const Frustum frustum(*camera, FrustumOptions());
  std::mt19937 engine(kSeed);
  int coarse = 0;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d at = Eigen::Vector3d(0, 0, 1.5) + 0.2 * random_vector(engine).cast<double>();
    const Eigen::Vector3d right = 0.01 * random_vector(engine).cast<double>();
    const Eigen::Vector3d down = 0.01 * random_vector(engine).cast<double>();
    Matrix23d jacobian;
    ASSERT_TRUE(camera->project(at, &jacobian));
    Warp warp;
    warp << (jacobian * right).cast<float>(), (jacobian * down).cast<float>();
    const float area = std::abs(warp.determinant());
    PointBlock block = random_block(engine);
    const Eigen::Vector3f span = right.cross(down).cast<float>();
    block.x[0] = static_cast<float>(at.x()), block.y[0] = static_cast<float>(at.y());
    block.z[0] = static_cast<float>(at.z());
    block.span_x[0] = span.x(), block.span_y[0] = span.y(), block.span_z[0] = span.z();
    const bool is_coarse = (view_block(block, frustum, SE3(), 525).coarse & 1) != 0;
    if (std::abs(area - 12) < 0.01) continue;
    EXPECT_EQ(is_coarse, area > 12) << area;
    coarse += is_coarse ? 1 : 0;
  }
  EXPECT_GT(coarse, 50);
  EXPECT_LT(coarse, 250);
}

}  // namespace
}  // namespace cairn
