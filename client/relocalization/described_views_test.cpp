// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/described_views.h"

#include <gtest/gtest.h>

#include "client/tracking/plane_scene.h"

namespace cairn {
namespace {

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, 0, 0, 0, 0}});
}

SE3 looking_down(double x, double y, double roll = 0, double height = 1) {
  const Eigen::Matrix3d down = (Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished();
  const Eigen::Quaterniond camera_from_map =
      Eigen::Quaterniond(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ())) * Eigen::Quaterniond(down);
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, height))};
}

/// A plane that was seen from its only keyframe, all points found.
class DescribedViewsTest : public ::testing::Test {
 protected:
  DescribedViewsTest() {
    const KeyframePose& keyframe = map->keyframe_blocks.front()->keyframes.front();
    reference = keyframe.id;
    std::vector<SeenPoint> points;
    for (const auto& block : map->point_blocks) {
      for (int slot = 0; slot < block->count; ++slot) {
        const PointSource& source = block->source(slot);
        const auto pixel = camera->project(home * block->position(slot));
        points.push_back({source.id, pixel->cast<float>(), source.level});
      }
    }
    const FrameImages frame = shown(home);
    views.remember(frame, *map, {reference, SE3(), 1.0}, points);
  }
  FrameImages shown(const SE3& pose) {
    FrameImages frame;
    frame.build_pyramid(scene.render(pose)->view());
    return frame;
  }
  std::optional<SE3> recognized(const SE3& pose, const MapSnapshot& in) {
    const FrameImages frame = shown(pose);
    return views.recognize(describe_place(frame.pyramid, frame.all_corners()), *camera, in, home, 1.0, 1);
  }

  CameraPtr camera = test_camera();
  test::PlaneScene scene{21, camera};
  SE3 home = looking_down(0, 0);
  MapSnapshotPtr map = scene.make_map(home);
  KeyframeId reference;
  DescribedViews views{DescribedViewsOptions()};
};

TEST_F(DescribedViewsTest, APlaceIsRecognizedFromAsideRolledAndFromFarther) {
  for (const SE3& pose :
       {looking_down(0.1, 0.05), looking_down(0.05, -0.05, 0.8), looking_down(-0.05, 0, -0.3, 1.2)}) {
    const auto found = recognized(pose, *map);
    ASSERT_TRUE(found);
    const Vector6d off = (*found * pose.inverse()).log();
    EXPECT_LT(off.head<3>().norm(), 0.02);
    EXPECT_LT(off.tail<3>().norm(), 0.02);
  }
}

TEST_F(DescribedViewsTest, WhatItHasNotSeenItDoesNotRecognize) {
  EXPECT_FALSE(recognized(looking_down(30, 20), *map));  // the texture does not repeat so near
  MapSnapshot other = *map;
  other.map.bytes[0] ^= 1;
  EXPECT_FALSE(views.knows(other));
  EXPECT_FALSE(recognized(home, other));
}

TEST_F(DescribedViewsTest, WhoHasSeenNothingKnowsNothing) {
  EXPECT_TRUE(views.knows(*map));
  DescribedViews empty{DescribedViewsOptions()};
  EXPECT_FALSE(empty.knows(*map));
  EXPECT_FALSE(empty.recognize({}, *camera, *map, home, 1.0, 1));
}

}  // namespace
}  // namespace cairn
