// SPDX-License-Identifier: Apache-2.0
//
// A program of its own: it counts what is taken from the heap, by whatever name (Eigen does not ask operator
// new). Sanitizers have a heap of theirs; with them it is not built.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "client/tracking/plane_scene.h"
#include "client/tracking/provisional_points.h"
#include "client/tracking/round_room.h"
#include "client/tracking/tracker.h"

namespace {
std::atomic<size_t> allocations{0};
}  // namespace

// glibc's own names for what stands behind the functions replaced here.
// NOLINTBEGIN(readability-identifier-naming)
extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* memory, size_t size);
void* __libc_memalign(size_t alignment, size_t size);

void* malloc(size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, size_t size) {
  ++allocations;
  return __libc_realloc(memory, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
}
// NOLINTEND(readability-identifier-naming)

namespace cairn {
namespace {

/// A camera one metre above the plane, looking down at (x, y).
SE3 looking_down(double x, double y) {
  const Eigen::Quaterniond camera_from_map(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, 1.0))};
}

TEST(Allocations, AreSeenHere) {
  const size_t before = allocations;
  const auto number = std::make_unique<int>(1);
  const Eigen::VectorXd vector = Eigen::VectorXd::Constant(100, *number);
  const auto pixels = std::make_unique<GrayImage>(64, 64);
  EXPECT_EQ(allocations - before, 4U) << vector.size() << " numbers, " << pixels->width() << " columns";
}

/// Round and round: what the first rounds had to learn (templates, places, what stands still, how much memory
/// an image takes) the later ones know. The way is too short for a keyframe.
TEST(Allocations, ATrackedFrameThatAddsNothingNewTakesNone) {
  constexpr int kRound = 24;          // frames
  constexpr int kRoundsToLearn = 34;  // what stands still is looked for in every eighth of 800 frames
  const CameraPtr camera = *make_camera(
      {CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02, 0.001, -0.001}});
  const test::PlaneScene scene(3, camera);
  const MapSnapshotPtr map = scene.make_map(looking_down(0, 0));
  std::vector<GrayImagePtr> images;
  for (int i = 0; i < kRound; ++i) {
    const double angle = 2 * M_PI * i / kRound;
    images.push_back(scene.render(looking_down(0.04 * std::cos(angle), 0.04 * std::sin(angle))));
  }
  Tracker tracker(camera, {});
  static_cast<void>(tracker.relocalization_answered(
      PoseHypothesis{map->map, map->epoch, KeyframeId{1}, looking_down(0, 0)}));
  for (int i = 0; i < (kRoundsToLearn + 5) * kRound; ++i) {
    const GrayImagePtr& image = images[static_cast<size_t>(i % kRound)];
    const size_t before = allocations;
    const FrameResult& result = tracker.track(image, {int64_t{33'333'333} * i}, map);
    const size_t taken = allocations - before;
    if (i < kRoundsToLearn * kRound) continue;
    ASSERT_TRUE(result.pose_measured) << "frame " << i << " " << result.note;
    ASSERT_FALSE(result.keyframe) << "frame " << i;
    EXPECT_EQ(taken, 0U) << "frame " << i << ", " << result.found << " of " << result.attempted;
  }
}

/// Corners are followed, dropped and begun, the camera to and fro.
TEST(Allocations, FollowingWhatIsProvisionalTakesNone) {
  constexpr int kRound = 10;  // frames
  const CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
  const test::RoundRoom room(3, camera, 2);
  const MapSnapshotPtr map = room.empty_map(SE3());
  std::vector<SE3> poses;
  std::vector<GrayImagePtr> images;
  for (int i = 0; i < kRound; ++i) {
    const double angle = 2 * M_PI * i / kRound;
    poses.emplace_back(so3_exp({0, 0.15 * std::cos(angle), 0}),
                       Eigen::Vector3d(0.02 * std::sin(angle), 0, 0));
    images.push_back(room.render(poses.back(), 2, static_cast<uint64_t>(i)));
  }
  ProvisionalPoints points(camera, ProvisionalPointsOptions(), PoseJudgementOptions());
  FrameImages frame;
  const auto follow = [&](size_t i) {
    frame.build_pyramid(images[i]->view());
    points.follow(frame, poses[i], *map);
    const auto found = points.locate(poses[i], {}, 2);
    points.update(frame, {poses[i], Matrix6d::Zero(), PoseSupport::kPosition, 2}, *map, {});
    return found.has_value();
  };
  for (size_t i = 0; i < 12 * kRound; ++i) static_cast<void>(follow(i % kRound));
  const size_t before = allocations;
  size_t found = 0;
  for (size_t i = 0; i < 4 * kRound; ++i) found += follow(i % kRound) ? 1 : 0;
  EXPECT_EQ(allocations - before, 0U);
  EXPECT_EQ(found, 4U * kRound);
}

}  // namespace
}  // namespace cairn
