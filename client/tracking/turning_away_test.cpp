// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "client/tracking/round_room.h"
#include "client/tracking/seeded_tracker.h"

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
  tracker.seed_accepted(test::answer_with(*map));
  constexpr double kStep = 2.5 * M_PI / 180;  // a frame: 75 degrees per second
  constexpr int kStill = 10;                  // frames
  constexpr int kTurn = 32;
  int rotations = 0;
  for (int i = 0; i < 2 * kStill + 2 * kTurn + kStill; ++i) {
    const double yaw = kStep * std::clamp(std::min(i - kStill, 2 * kStill + 2 * kTurn - i), 0, kTurn);
    const FrameResult& result =
        tracker.track(room.render(turned(yaw), 2, static_cast<uint64_t>(i)), {i * kFrameTime}, map);
    if (result.reloc_query) static_cast<void>(tracker.relocalization_answered(std::nullopt));
    if (i < kStill) continue;
    ASSERT_NE(result.state, TrackingState::kLost) << "frame " << i << ": " << result.note;
    EXPECT_LT((result.camera_from_map * turned(yaw).inverse()).log().tail<3>().norm(), 0.02) << "frame " << i;
    EXPECT_EQ(result.pose_measured, result.state != TrackingState::kRotation);
    EXPECT_FALSE(result.state == TrackingState::kRotation && result.keyframe) << "it has no parallax";
    rotations += result.state == TrackingState::kRotation ? 1 : 0;
  }
  EXPECT_GT(rotations, kStill) << "the map does not reach there";
}

/// The camera turns to where nothing shows at all, stays there for two seconds and comes back. A gyro that is
/// turned to the camera, with a bias.
struct BlankTurn {
  static constexpr int kStill = 40;  // frames
  static constexpr int kTurn = 24;
  static constexpr int kAway = 60;
  static double yaw(double frame) {
    const double going = std::min(frame - kStill, 2 * kTurn + kAway + kStill - frame) / kTurn;
    return 80 * M_PI / 180 * (1 - std::cos(M_PI * std::clamp(going, 0.0, 1.0))) / 2;
  }
  static SE3 pose(double frame) { return {so3_exp({0, yaw(frame), 0}), Eigen::Vector3d::Zero()}; }
  static bool is_blank(double frame) { return yaw(frame) > 55 * M_PI / 180; }

  /// Lost frames; the greatest error of the rotation of those that are not is given back [rad].
  static int lost(bool has_gyro, double* worst) {
    const CameraPtr camera =
        *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
    const test::RoundRoom room(3, camera, 2);
    const MapSnapshotPtr map = room.map_of(SE3());
    Tracker tracker(camera, {});
    const ImuMount mount{so3_exp({1.2, -0.4, 2.0}), {}};
    if (has_gyro) tracker.use_imu(mount);
    tracker.seed_accepted(test::answer_with(*map));
    const auto blank = std::make_shared<const GrayImage>(320, 240);
    int lost_frames = 0;
    for (int i = 0; i < 2 * kStill + 2 * kTurn + kAway; ++i) {
      std::vector<ImuSample> samples;
      for (double t = i - 0.75; t <= i + 0.01; t += 0.25) {
        ImuSample sample;
        sample.time = Timestamp{static_cast<int64_t>(t * kFrameTime)};
        // Camera from map by yaw(t) about y: the camera turns the other way round.
        const Eigen::Vector3d rate(0, -(yaw(t + 0.01) - yaw(t - 0.01)) / (0.02 * kFrameTime * 1e-9), 0);
        sample.rate = mount.camera_from_imu.conjugate() * (rate + Eigen::Vector3d(0.01, -0.01, 0.02));
        samples.push_back(sample);
      }
      if (has_gyro) tracker.add_samples(samples);
      const auto image = is_blank(i) ? blank : room.render(pose(i), 2, static_cast<uint64_t>(i));
      const FrameResult& result = tracker.track(image, {i * kFrameTime}, map);
      if (result.reloc_query) static_cast<void>(tracker.relocalization_answered(std::nullopt));
      EXPECT_FALSE(is_blank(i) && result.pose_measured);
      if (i < kStill) continue;  // it proves where it is
      if (result.state == TrackingState::kLost) {
        ++lost_frames;
      } else {
        *worst = std::max(*worst, (result.camera_from_map * pose(i).inverse()).log().tail<3>().norm());
      }
    }
    return lost_frames;
  }
};

TEST(TurningAway, AGyroCarriesTheRotationWhereNothingShows) {
  double worst = 0;
  EXPECT_EQ(BlankTurn::lost(true, &worst), 0);
  EXPECT_LT(worst, 0.02);
  EXPECT_GT(BlankTurn::lost(false, &worst), 30) << "without one it is lost";
}

/// Each frame is exposed all the time: the image is smeared by up to 16 px, and no corners are left.
TEST(TurningAway, AQuickSmearedTurnIsHeld) {
  const CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
  const test::RoundRoom room(3, camera, 2);
  const MapSnapshotPtr map = room.map_of(SE3());
  Tracker tracker(camera, {});
  tracker.seed_accepted(test::answer_with(*map));
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
    if (result.reloc_query) static_cast<void>(tracker.relocalization_answered(std::nullopt));
    if (i < kStill) continue;
    ASSERT_NE(result.state, TrackingState::kLost) << "frame " << i << ": " << result.note;
    EXPECT_LT((result.camera_from_map * turned(yaw_at(i)).inverse()).log().tail<3>().norm(), 0.035)
        << "frame " << i;
  }
}

}  // namespace
}  // namespace cairn
