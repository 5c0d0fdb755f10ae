// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "client/tracking/round_room.h"
#include "client/tracking/tracker.h"

namespace cairn {
namespace {

constexpr int64_t kFrameTime = 33'333'333;  // [ns]

/// The map shows one view of a room; the camera turns away from it by 80 degrees, waits and comes back.
TEST(TurningAway, AwayFromTheMapOnlyTheRotationIsToldAndTheWayBackNeedsNoRelocalization) {
  const CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
  const test::RoundRoom room(3, camera, 2);
  const MapSnapshotPtr map = room.map_of(SE3());
  Tracker tracker(camera, {});
  const auto turned = [](double yaw) { return SE3(so3_exp({0, yaw, 0}), Eigen::Vector3d::Zero()); };
  SeedAnswer answer;
  answer.map = map->map;
  answer.second_keyframe = KeyframeId{1};
  tracker.seed_accepted(answer);
  constexpr double kStep = 2.5 * M_PI / 180;  // a frame: 75 degrees per second
  constexpr int kStill = 10;                  // frames
  constexpr int kTurn = 32;
  int rotations = 0;
  for (int i = 0; i < 2 * kStill + 2 * kTurn + kStill; ++i) {
    const double yaw = kStep * std::clamp(std::min(i - kStill, 2 * kStill + 2 * kTurn - i), 0, kTurn);
    const FrameResult& result =
        tracker.track(room.render(turned(yaw), 2, static_cast<uint64_t>(i)), {i * kFrameTime}, map);
    if (result.place_question) static_cast<void>(tracker.place_answered(std::nullopt));
    if (i < kStill) continue;
    ASSERT_NE(result.state, TrackingState::kLost) << "frame " << i << ": " << result.note;
    EXPECT_LT((result.camera_from_map * turned(yaw).inverse()).log().tail<3>().norm(), 0.02) << "frame " << i;
    EXPECT_EQ(result.pose_measured, result.state != TrackingState::kRotation);
    EXPECT_FALSE(result.state == TrackingState::kRotation && result.keyframe) << "it has no parallax";
    rotations += result.state == TrackingState::kRotation ? 1 : 0;
  }
  EXPECT_GT(rotations, kStill) << "the map does not reach there";
}

/// Each frame is exposed all the time: the picture is smeared by up to 16 px, and no corners are left.
TEST(TurningAway, AQuickSmearedTurnIsHeld) {
  const CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
  const test::RoundRoom room(3, camera, 2);
  const MapSnapshotPtr map = room.map_of(SE3());
  Tracker tracker(camera, {});
  SeedAnswer answer;
  answer.map = map->map;
  answer.second_keyframe = KeyframeId{1};
  tracker.seed_accepted(answer);
  constexpr double kFull = 35 * M_PI / 180;
  constexpr int kStill = 5;  // frames
  constexpr int kTurn = 16;
  const auto yaw_at = [](double frame) {
    return kFull * (1 - std::cos(M_PI * std::clamp((frame - kStill) / kTurn, 0.0, 1.0))) / 2;
  };
  const auto turned = [](double yaw) { return SE3(so3_exp({0, yaw, 0}), Eigen::Vector3d::Zero()); };
  for (int i = 0; i < 2 * kStill + kTurn; ++i) {
    const GrayImagePtr image =
        room.render_exposed([&](double t) { return turned(yaw_at(i + t)); }, 2, static_cast<uint64_t>(i));
    const FrameResult& result = tracker.track(image, {i * kFrameTime}, map);
    if (result.place_question) static_cast<void>(tracker.place_answered(std::nullopt));
    if (i < kStill) continue;
    ASSERT_NE(result.state, TrackingState::kLost) << "frame " << i << ": " << result.note;
    EXPECT_LT((result.camera_from_map * turned(yaw_at(i)).inverse()).log().tail<3>().norm(), 0.035)
        << "frame " << i;
  }
}

}  // namespace
}  // namespace cairn
