// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/adjustment.h"

#include <gtest/gtest.h>

#include <random>
#include <span>

namespace cairn {
namespace {

constexpr double kNothing = 1e-9;
constexpr double kNoOutliers = 1e9;

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, 0, 0, 0, 0}});
}

/// A map whose keyframes look at walls of points, each of which all keyframes given for it measure exactly.
class Walls {
 public:
  explicit Walls(int keyframes) {
    for (int i = 0; i < keyframes; ++i) {
      MapKeyframe k;
      k.camera = test_camera();
      const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.03 * i, Eigen::Vector3d(0.2, -1, 0).normalized()));
      const Eigen::Vector3d center(0.12 * i, 0.01 * i * i, 0.02 * i);
      k.camera_from_map = SE3(turned, -(turned * center));
      ids_.push_back(map.add_keyframe(std::move(k)));
    }
  }
  void add_wall(std::span<const KeyframeId> seen_from, double noise = 0) {
    std::normal_distribution<double> pixels(0, noise > 0 ? noise : 1);
    std::uniform_real_distribution<double> aside(-0.4, 0.4);
    for (int i = 0; i < 40; ++i) {
      const SE3 pose = map.keyframe(seen_from.front()).camera_from_map;
      const double depth = 2 + aside(random_);
      const Eigen::Vector3d place =
          pose.inverse() * Eigen::Vector3d(depth * aside(random_), depth * aside(random_), depth);
      PointSource source;
      source.keyframe = seen_from.front();
      const PointId point = map.add_point(source, place);
      for (const KeyframeId id : seen_from) {
        auto pixel = test_camera()->project(map.keyframe(id).camera_from_map * place);
        ASSERT_TRUE(pixel);
        if (noise > 0) *pixel += Eigen::Vector2d(pixels(random_), pixels(random_));
        map.add_measurement(id, {point, 0, pixel->cast<float>()});
      }
    }
    for (const KeyframeId id : seen_from) map.update_depths(id);
  }
  [[nodiscard]] std::span<const KeyframeId> ids(size_t first, size_t count) const {
    return std::span(ids_).subspan(first, count);
  }

  MapState map;

 private:
  std::vector<KeyframeId> ids_;
  std::mt19937 random_{7};
};

/// The whole problem, turned, moved and scaled.
MapProblem carried_off(const MapState& map, double scale, const SE3& motion) {
  MapProblem solved = global_problem(map, SelfCalibrationOptions());
  for (BundlePose& pose : solved.bundle.poses) {
    const SE3 there = pose.camera_from_map * motion.inverse();
    pose.camera_from_map = SE3(there.rotation(), scale * there.translation());
  }
  for (Eigen::Vector3d& point : solved.bundle.points) point = scale * (motion * point);
  return solved;
}

void expect_same_place(const MapState& a, const MapState& b) {
  for (size_t i = 0; i < a.keyframes().size(); ++i) {
    const SE3& pose = a.keyframes()[i].camera_from_map;
    const SE3& other = b.keyframes()[i].camera_from_map;
    if (!a.keyframes()[i].live) continue;
    EXPECT_LT((pose.center() - other.center()).norm(), kNothing) << "keyframe " << i + 1;
    EXPECT_LT(pose.rotation().angularDistance(other.rotation()), 1e-7) << "keyframe " << i + 1;
  }
  for (const PointId id : a.live_point_ids())
    EXPECT_LT((a.point(id).position - b.point(id).position).norm(), kNothing);
}

/// Frame and unit are nobody's to know: a map whose shape has not changed does not move.
TEST(Adjustment, AMapThatWasOnlyCarriedOffIsWrittenBackWhereItWas) {
  for (const bool one_is_removed : {false, true}) {
    SCOPED_TRACE(one_is_removed);
    Walls walls(6);
    walls.add_wall(walls.ids(0, 6));
    MapState& map = walls.map;
    const MapProblem solved =
        carried_off(map, 1.3, SE3(so3_exp({0.2, -0.4, 0.1}), Eigen::Vector3d(0.5, 2, -1)));
    if (one_is_removed) map.remove_keyframe(KeyframeId{4});  // since the problem was cut
    MapState before = map;
    write_back(solved, kNoOutliers, SelfCalibrationOptions(), &map);
    expect_same_place(map, before);
  }
}

TEST(Adjustment, WhatCameSinceTheProblemWasCutIsCarriedBackWithTheRest) {
  Walls walls(7);
  walls.add_wall(walls.ids(0, 6));
  MapState earlier = walls.map;
  earlier.remove_keyframe(KeyframeId{7});
  walls.add_wall(walls.ids(5, 2));
  walls.map.keyframe(KeyframeId{7}).reference = KeyframeId{6};
  const MapState before = walls.map;
  write_back(carried_off(earlier, 1, SE3(so3_exp({0.2, -0.4, 0.1}), Eigen::Vector3d(0.5, 2, -1))),
             kNoOutliers, SelfCalibrationOptions(), &walls.map);
  expect_same_place(walls.map, before);
}

TEST(Adjustment, WhatOneKeyframeLearnsOfItselfMovesItAndHardlyTheOthers) {
  constexpr double kMoved = 0.01;
  Walls walls(8);
  walls.add_wall(walls.ids(0, 8));
  const MapState before = walls.map;
  // A solver holds the first keyframe; what it learns of it, all the others tell.
  const SE3 first = walls.map.keyframe(KeyframeId{1}).camera_from_map;
  MapProblem solved = carried_off(walls.map, 1, SE3(Eigen::Quaterniond::Identity(), {0, kMoved, 0}));
  solved.bundle.poses.front().camera_from_map = first;
  write_back(solved, kNoOutliers, SelfCalibrationOptions(), &walls.map);
  for (size_t i = 0; i < before.keyframes().size(); ++i) {
    const double moved =
        (walls.map.keyframes()[i].camera_from_map.center() - before.keyframes()[i].camera_from_map.center())
            .norm();
    if (i == 0) {
      EXPECT_GT(moved, 0.5 * kMoved);
    } else {
      EXPECT_LT(moved, 0.4 * kMoved) << "keyframe " << i + 1;
    }
  }
}

TEST(Adjustment, ALocalOneMovesNothingOutsideItself) {
  Walls walls(9);
  walls.add_wall(walls.ids(0, 6));
  walls.add_wall(walls.ids(5, 2), 1);  // alone joins them: one keyframe is fixed
  walls.add_wall(walls.ids(6, 3), 1);
  const MapState before = walls.map;
  MapMakerOptions options;
  options.local_keyframes = 2;
  ASSERT_TRUE(adjust_locally(&walls.map, KeyframeId{9}, options, [] { return false; }).usable);
  EXPECT_GT((walls.map.keyframe(KeyframeId{9}).camera_from_map.center() -
             before.keyframe(KeyframeId{9}).camera_from_map.center())
                .norm(),
            1e-5)
      << "it has something to do";
  for (uint64_t id = 1; id <= 6; ++id) {
    const SE3& pose = walls.map.keyframe(KeyframeId{id}).camera_from_map;
    EXPECT_EQ(pose.translation(), before.keyframe(KeyframeId{id}).camera_from_map.translation());
    EXPECT_EQ(pose.rotation_matrix(), before.keyframe(KeyframeId{id}).camera_from_map.rotation_matrix());
  }
}

}  // namespace
}  // namespace cairn
