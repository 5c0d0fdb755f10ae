// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/provisional_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "client/tracking/motion.h"
#include "client/tracking/round_room.h"

namespace cairn {
namespace {

using KnownPose = ProvisionalPoints::KnownPose;

constexpr double kRadius = 2;  // [m] of the room
constexpr double kNoise = 3;   // grey values
constexpr double kDegree = M_PI / 180;

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
}

/// A camera at a place in the room, turned by `yaw` [rad] about the vertical.
SE3 looking(double yaw, const Eigen::Vector3d& center) {
  const Eigen::Quaterniond camera_from_map = so3_exp({0, -yaw, 0});
  return {camera_from_map, -(camera_from_map * center)};
}

double rotation_error(const SE3& a, const SE3& b) {
  return so3_log(a.rotation() * b.rotation().conjugate()).norm();
}

/// A room, what is provisional in it, and a camera that is followed frame by frame.
class ProvisionalPointsTest : public ::testing::Test {
 protected:
  CameraPtr camera_ = test_camera();
  test::RoundRoom room_{3, camera_, kRadius};
  MapSnapshotPtr map_ = room_.empty_map(SE3());
  ProvisionalPoints points_{camera_, ProvisionalPointsOptions(), PoseJudgementOptions()};
  std::array<FrameImages, 2> frames_;
  size_t shots_ = 0;
  SE3 last_;

  FrameImages& now() { return frames_[shots_ % 2]; }

  /// The next frame; where the tracker would look for the camera.
  SE3 shoot(const SE3& truth) {
    const FrameImages& previous = now();
    ++shots_;
    now().build_pyramid(room_.render(truth, kNoise, shots_)->view());
    now().build_tiny();
    if (shots_ == 1) return truth;
    return correct_step(SE3(), align_tiny(previous.tiny, now().tiny), *camera_, kRadius,
                        StepCorrectionOptions()) *
           last_;
  }
  /// Into the next frame; where the tracker would look for the camera.
  SE3 follow(const SE3& truth) {
    const SE3 predicted = shoot(truth);
    points_.follow(now(), predicted, *map_);
    return predicted;
  }
  /// The map says where the camera is.
  void with_map(const SE3& truth) {
    follow(truth);
    points_.update(now(), {truth, Matrix6d::Zero(), PoseSupport::kPosition, kRadius}, *map_, {});
    last_ = truth;
  }
  /// Nothing but what is provisional does.
  std::optional<ProvisionalPoints::Located> without_map(const SE3& truth) {
    const SE3 predicted = follow(truth);
    const auto found = points_.locate(predicted, {}, kRadius);
    if (!found) return std::nullopt;
    points_.update(now(), {found->camera_from_map, found->covariance, found->judgement.support, kRadius},
                   *map_, {});
    last_ = found->camera_from_map;
    return found;
  }
  double true_inverse_depth(const ProvisionalPoints::Followed& p) const {
    return 1 / room_.distance(p.anchor_from_map, p.bearing);
  }
};

class Pan : public ProvisionalPointsTest, public ::testing::WithParamInterface<double> {};

/// 90 degrees away from all that the map knows, a while there, and back.
TEST_P(Pan, TheRotationHoldsAwayFromTheMapAndBack) {
  const double step = GetParam() / 30 * kDegree;
  const int away = static_cast<int>(90 * kDegree / step);
  for (int i = 0; i < 4; ++i) with_map(looking(0, {0, 0, 0}));
  double worst = 0;
  for (int i = 0; i < 2 * away + 10; ++i) {
    const int left = std::min({i + 1, away, 2 * away + 9 - i});
    const SE3 truth = looking(step * left, {0, 0, 0});
    const SE3 before = last_;
    const auto found = without_map(truth);
    ASSERT_TRUE(found) << "frame " << i;
    EXPECT_EQ(found->judgement.support, PoseSupport::kRotation) << "frame " << i;
    EXPECT_LT((found->camera_from_map.center() - before.center()).norm(), 1e-4 * kRadius) << "frame " << i;
    worst = std::max(worst, rotation_error(found->camera_from_map, truth));
    ASSERT_LT(worst, 0.5 * kDegree) << "frame " << i;
    ASSERT_LE(points_.size(), ProvisionalPoints::kMostPoints);
  }
  std::printf("pan at %.0f degrees/s: rotation within %.3f degrees, position %.4f m off\n", GetParam(),
              worst / kDegree, last_.center().norm());
}
INSTANTIATE_TEST_SUITE_P(ProvisionalPoints, Pan, ::testing::Values(60.0, 150.0));

/// To the side with the map in view: the depths come out, and are as good as they say.
TEST_F(ProvisionalPointsTest, DepthsComeWithParallaxAndTheirVarianceIsHonest) {
  double innovations = 0;
  int measured = 0;
  constexpr int kFrames = 30;
  for (int i = 0; i <= kFrames; ++i) {
    with_map(looking(0, {0.6 * i / kFrames, 0, 0}));
    for (size_t k = 0; k < points_.size(); ++k) {
      const auto p = points_.at(k);
      if (p.innovation < 0) continue;
      innovations += p.innovation;
      ++measured;
    }
  }
  ASSERT_GT(measured, 1000);
  std::printf("innovation over variance %.2f\n", innovations / measured);
  EXPECT_LT(innovations / measured, 1.2);
  EXPECT_GT(innovations / measured, 0.005) << "patches of images of the world are good to a third of a pixel";
  int known = 0;
  int within_sigmas = 0;
  int within_share = 0;
  for (size_t k = 0; k < points_.size(); ++k) {
    const auto p = points_.at(k);
    const double truth = true_inverse_depth(p);
    if (std::sqrt(p.variance) > 0.05 * truth) continue;
    ++known;
    within_sigmas += std::abs(p.inverse_depth - truth) < 3 * std::sqrt(p.variance) ? 1 : 0;
    within_share += std::abs(p.inverse_depth - truth) < 0.05 * truth ? 1 : 0;
  }
  std::printf("%d of %zu depths known, %d within 3 sigma, %d within 5 %%\n", known, points_.size(),
              within_sigmas, within_share);
  EXPECT_GT(known, 50);
  EXPECT_GE(within_sigmas, 0.97 * known);
  EXPECT_GE(within_share, 0.97 * known);
}

/// What is offered to a map maker is in the frame's own camera, honest, and keeps its name.
TEST_F(ProvisionalPointsTest, CandidatesAreThoseFoundWhoseDepthsAreKnown) {
  for (int i = 0; i < 4; ++i) with_map(looking(0, {0, 0, 0}));
  EXPECT_TRUE(points_.candidates(last_).empty()) << "nothing has been seen from two places";
  std::vector<PointCandidate> before;
  for (int i = 1; i <= 30; ++i) {
    before = points_.candidates(last_);
    with_map(looking(0.1, {0.02 * i, 0, 0.01 * i}));
  }
  const std::vector<PointCandidate> known = points_.candidates(last_);
  ASSERT_GT(known.size(), 50U);
  EXPECT_LE(known.size(), ProvisionalPoints::kMostPoints);
  size_t honest = 0;
  size_t again = 0;
  for (const PointCandidate& c : known) {
    const double truth = 1 / room_.distance(last_, camera_->unproject(c.pixel.cast<double>()));
    EXPECT_LE(c.sigma, 0.2 * c.inverse_depth * 1.001);
    honest += std::abs(c.inverse_depth - truth) < 3 * c.sigma ? 1 : 0;
    again += std::any_of(before.begin(), before.end(), [&](const PointCandidate& b) {
      return b.id == c.id && (b.pixel - c.pixel).norm() < 15;
    });
  }
  EXPECT_GE(honest, known.size() * 97 / 100);
  EXPECT_GE(again, known.size() * 3 / 4);
}

/// Depths that are known hold the position, too; who only turns learns none.
TEST_F(ProvisionalPointsTest, KnownDepthsHoldThePosition) {
  for (int i = 0; i <= 20; ++i) with_map(looking(0, {0.03 * i, 0, 0}));
  for (int i = 1; i <= 10; ++i) {
    const SE3 truth = looking(0, {0.6, 0.02 * i, 0});
    const auto found = without_map(truth);
    ASSERT_TRUE(found) << "frame " << i;
    EXPECT_EQ(found->judgement.support, PoseSupport::kPosition) << found->judgement.position_sigma;
    EXPECT_LT((found->camera_from_map.center() - truth.center()).norm(), 0.01 * kRadius) << "frame " << i;
    // Who is off to the side by 1 % of the depth is turned by as much.
    EXPECT_LT(rotation_error(found->camera_from_map, truth), 0.6 * kDegree) << "frame " << i;
  }
}

TEST_F(ProvisionalPointsTest, TheyRideOnAdjustmentsAndEndWithTheirKeyframe) {
  for (int i = 0; i < 4; ++i) with_map(looking(0, {0, 0, 0}));
  ASSERT_GT(points_.size(), 50U);
  const SE3 moved = looking(0.5, {0.3, 0.2, 0.1});
  map_ = room_.empty_map(moved, 2);
  points_.follow(now(), moved, *map_);
  const auto found = points_.locate(moved, {}, kRadius);
  ASSERT_TRUE(found);
  EXPECT_LT((found->camera_from_map * moved.inverse()).log().norm(), 1e-3);
  auto other = std::make_shared<MapSnapshot>(*map_);
  other->keyframe_blocks.clear();
  points_.follow(now(), moved, *other);
  EXPECT_EQ(points_.size(), 0U);
  EXPECT_FALSE(points_.locate(moved, {}, kRadius));
}

/// Where the map has a point in each cell, none is begun and nothing is looked for.
TEST_F(ProvisionalPointsTest, NoneAreBegunWhereTheMapHasPoints) {
  std::vector<VisiblePoint> of_map;
  for (int x = 10; x < 160; x += 20) {
    for (int y = 10; y < 240; y += 20) {
      VisiblePoint p;
      p.found = true;
      p.pixel = {static_cast<float>(x), static_cast<float>(y)};
      of_map.push_back(p);
    }
  }
  for (int i = 0; i < 6; ++i) {
    follow(SE3());
    points_.update(now(), {SE3(), Matrix6d::Zero(), PoseSupport::kPosition, kRadius}, *map_, of_map);
  }
  ASSERT_GT(points_.size(), 20U);
  for (size_t i = 0; i < points_.size(); ++i) EXPECT_GE(points_.at(i).pixel.x(), 160);
}

/// What moves by itself agrees with no pose and goes.
TEST_F(ProvisionalPointsTest, WhatDoesNotAgreeWithThePoseGoes) {
  for (int i = 0; i < 4; ++i) with_map(looking(0, {0, 0, 0}));
  const size_t before = points_.size();
  ASSERT_GT(before, 50U);
  const SE3 lie = looking(2 * kDegree, {0, 0, 0});
  const auto tell = [&] {
    follow(SE3());
    points_.update(now(), {lie, Matrix6d::Zero(), PoseSupport::kRotation, kRadius}, *map_, {});
    last_ = SE3();
  };
  tell();
  EXPECT_GE(points_.size(), before) << "once is chance";
  tell();
  size_t old = 0;
  for (size_t i = 0; i < points_.size(); ++i)
    old += rotation_error(points_.at(i).anchor_from_map, SE3()) < 1e-9;
  EXPECT_LT(old, before / 5);
}

TEST_F(ProvisionalPointsTest, EqualFramesGiveEqualBits) {
  const auto run = [&] {
    points_.clear();
    shots_ = 0;
    for (int i = 0; i < 4; ++i) with_map(looking(0, {0, 0, 0}));
    for (int i = 1; i <= 5; ++i) static_cast<void>(without_map(looking(i * 3 * kDegree, {0, 0, 0})));
    return last_;
  };
  const SE3 first = run();
  const SE3 second = run();
  EXPECT_EQ(first.rotation().coeffs(), second.rotation().coeffs());
  EXPECT_EQ(first.translation(), second.translation());
}

TEST(JudgePose, SaysWhatIsDetermined) {
  Matrix6d information = Matrix6d::Zero();
  EXPECT_EQ(judge_pose(information, 1, PoseJudgementOptions()).support, PoseSupport::kNone);
  information.bottomRightCorner<3, 3>().diagonal().setConstant(1e6);  // 1 mrad
  EXPECT_EQ(judge_pose(information, 1, PoseJudgementOptions()).support, PoseSupport::kRotation);
  EXPECT_NEAR(judge_pose(information, 1, PoseJudgementOptions()).rotation_sigma, 1e-3, 1e-9);
  information.topLeftCorner<3, 3>().diagonal() << 1e6, 1e6, 1e2;  // 10 cm along the axis
  EXPECT_EQ(judge_pose(information, 1, PoseJudgementOptions()).support, PoseSupport::kRotation);
  EXPECT_EQ(judge_pose(information, 20, PoseJudgementOptions()).support, PoseSupport::kPosition)
      << "0.5 % of the depth";
  // A step to the side that turning explains as well.
  information(0, 4) = information(4, 0) = 0.99999 * 1e6;
  EXPECT_EQ(judge_pose(information, 20, PoseJudgementOptions()).support, PoseSupport::kRotation);
  EXPECT_EQ(judge_pose(Matrix6d::Zero(), 1, PoseJudgementOptions()).support, PoseSupport::kNone);
}

}  // namespace
}  // namespace cairn
