// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/verified_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "client/tracking/plane_scene.h"

namespace cairn {
namespace {

Timestamp at(double seconds) {
  return {static_cast<int64_t>(std::llround(seconds * 1e9))};
}

SE3 seen_from(const Eigen::Vector3d& centre) {
  return {Eigen::Quaterniond::Identity(), -centre};
}

class VerifiedPathTest : public ::testing::Test {
 protected:
  void add(const Eigen::Vector3d& centre, double seconds) {
    path.add({map->map, keyframe.id, seen_from(centre) * keyframe.camera_from_map.inverse()}, at(seconds));
  }
  /// Along x at this speed, with steps of this acceleration along all axes.
  Eigen::Vector3d walk(double speed, double acceleration, double seconds, double scale = 1) {
    std::mt19937 random(3);
    std::normal_distribution<double> push(0, acceleration * std::sqrt(kStep));
    Eigen::Vector3d velocity(speed, 0, 0);
    Eigen::Vector3d centre(0.3, -0.2, 1);
    const int frames = static_cast<int>(std::lround(seconds / kStep));
    for (int i = 0; i <= frames; ++i) {
      add(scale * centre, i * kStep);
      centre += kStep * velocity;
      velocity += Eigen::Vector3d(push(random), push(random), push(random));
    }
    end = frames * kStep;
    return centre - kStep * velocity;
  }
  [[nodiscard]] ReachableRegion after(double seconds) const {
    const auto region = path.reachable(*map, at(end + seconds));
    EXPECT_TRUE(region);
    return region.value_or(ReachableRegion{});
  }

  static constexpr double kStep = 1.0 / 30;
  CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, 0, 0, 0, 0}});
  test::PlaneScene scene{21, camera};
  MapSnapshotPtr map = scene.make_map(seen_from({0, 0, -1}));
  KeyframePose keyframe = map->keyframe_blocks.front()->keyframes.front();
  VerifiedPath path{VerifiedPathOptions()};
  double end = 0;
};

TEST_F(VerifiedPathTest, APathThatIsShorterThanTwoSpacingsSaysNothing) {
  VerifiedPathOptions options;
  options.spacing = 0.07;
  path = VerifiedPath(options);
  walk(1.4, 0, 4 * kStep);
  EXPECT_GE(end, options.shortest);
  EXPECT_FALSE(path.reachable(*map, at(end)));
  path.clear();
  walk(1.4, 0, 3);
  EXPECT_TRUE(path.reachable(*map, at(end)));
}

TEST_F(VerifiedPathTest, WhoWalksSteadilyGoesOn) {
  walk(1.4, 0, 3);
  const ReachableRegion region = after(1);
  EXPECT_LT((region.centre - Eigen::Vector3d(0.3 + 1.4 * 4, -0.2, 1)).norm(), 1e-6);
  EXPECT_LT(region.radius, 1e-6);
}

/// The law of the uncertainty: with the power 3/2 of the time in the end.
TEST_F(VerifiedPathTest, TheLongerItIsHiddenTheLessIsKnown) {
  walk(1, 0.5, 3);
  EXPECT_LT(after(0.2).radius, after(0.4).radius);
  EXPECT_NEAR(after(400).radius / after(100).radius, 8, 0.1);
}

/// Neither the unit of the map nor how lively the hand is must be known.
TEST_F(VerifiedPathTest, TheRegionIsInTheUnitOfTheMotion) {
  walk(1, 0.5, 3);
  const double radius = after(1).radius;
  path.clear();
  walk(1, 0.5, 3, 7.0);
  EXPECT_NEAR(after(1).radius, 7 * radius, 1e-6 * radius);
  path.clear();
  walk(1, 2.0, 3);
  EXPECT_NEAR(after(1).radius, 4 * radius, 1e-6 * radius);
}

/// Of noise that is as the model says, all is within; and the region is no larger than it must be.
TEST_F(VerifiedPathTest, ItHoldsTheTruth) {
  std::mt19937 random(8);
  std::normal_distribution<double> push(0, 0.5 * std::sqrt(kStep));
  int inside = 0;
  double largest = 0;
  constexpr int kWalks = 200;
  for (int walked = 0; walked < kWalks; ++walked) {
    path.clear();
    Eigen::Vector3d velocity(1, 0, 0);
    Eigen::Vector3d centre(0, 0, 0);
    const auto step = [&] {
      centre += kStep * velocity;
      velocity += Eigen::Vector3d(push(random), push(random), push(random));
    };
    for (int i = 0; i < 80; ++i, step()) add(centre, i * kStep);
    end = 79 * kStep;
    for (int i = 0; i < 29; ++i) step();
    const ReachableRegion region = after(1);
    if (region.contains(seen_from(centre))) ++inside;
    largest = std::max(largest, (region.centre - centre).norm() / region.radius);
  }
  EXPECT_GE(inside, kWalks - 1);
  EXPECT_GT(largest, 0.3);
}

TEST_F(VerifiedPathTest, AShortPathAnotherMapAndTimeThatRunsBackSayNothing) {
  add({0, 0, 0}, 0);
  EXPECT_FALSE(path.reachable(*map, at(0.1)));
  add({0.1, 0, 0}, 0.033);
  EXPECT_FALSE(path.reachable(*map, at(0.1)));
  walk(1, 0.1, 2);
  EXPECT_FALSE(path.reachable(*map, at(1)));
  MapSnapshot other = *map;
  other.map.bytes[0] ^= 1;
  EXPECT_FALSE(path.reachable(other, at(3)));
  EXPECT_FALSE(path.last(other));
  path.clear();
  EXPECT_FALSE(path.reachable(*map, at(3)));
}

/// More frames than are kept, at any rate: the last two seconds count.
TEST_F(VerifiedPathTest, FastCamerasAreKeptForAsLong) {
  for (int i = 0; i < 1200; ++i) add({0.5 * i / 240.0, 0.3 * std::sin(i / 240.0 * 6), 0}, i / 240.0);
  end = 1199 / 240.0;
  const double fast = after(0.5).radius;
  path.clear();
  for (int i = 0; i < 150; ++i) add({0.5 * i / 30.0, 0.3 * std::sin(i / 30.0 * 6), 0}, i / 30.0);
  end = 149 / 30.0;
  EXPECT_NEAR(fast, after(0.5).radius, 0.1 * fast);
}

}  // namespace
}  // namespace cairn
