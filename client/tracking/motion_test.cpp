// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/motion.h"

#include <gtest/gtest.h>

#include "common/image/pyramid.h"

namespace cairn {
namespace {

constexpr int64_t kFrame = 33'333'333;  // [ns]

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {525, 525, 319.5, 239.5}});
}

TEST(MotionModel, PredictsConstantVelocityWhateverTheFrameSpacing) {
  const Vector6d velocity = (Vector6d() << 0.3, -0.1, 0.2, 0.1, 0.4, -0.2).finished();  // per second
  MotionModel model{MotionOptions()};
  SE3 pose;
  Timestamp time{1'000'000'000};
  model.reset(pose, time);
  // Frames are dropped now and then: the velocity is per second, so it does not care.
  for (const int step : {1, 1, 2, 1, 3, 1, 1, 2, 1, 1, 1, 1}) {
    const double seconds = step * kFrame * 1e-9;
    pose = SE3::exp(velocity * seconds) * pose;
    time = time + std::chrono::nanoseconds(step * kFrame);
    model.measured(pose, time);
  }
  // The velocity converges to decay / (2 - decay) of the truth: 0.9 / 1.1.
  EXPECT_NEAR(model.velocity().norm() / velocity.norm(), 0.9 / 1.1, 0.01);
  EXPECT_NEAR(model.velocity().normalized().dot(velocity.normalized()), 1.0, 1e-9);
}

TEST(MotionModel, MissedFramesLetTheVelocityDecay) {
  MotionModel model{MotionOptions()};
  model.reset(SE3(), {0});
  model.measured(SE3::exp((Vector6d() << 0.01, 0, 0, 0, 0, 0).finished()), {kFrame});
  const double before = model.velocity().norm();
  model.missed(SE3());
  EXPECT_LT(model.velocity().norm(), before);
  EXPECT_GT(before, 0);
}

// Frames that fail one after another would else be looked at from where the camera was before all of them.
TEST(MotionModel, TurnsOfMissedFramesAddUp) {
  MotionModel model{MotionOptions()};
  model.reset(SE3(), {0});
  const SE3 turn(so3_exp(Eigen::Vector3d(0, 0.05, 0)), Eigen::Vector3d::Zero());
  for (int i = 0; i < 3; ++i) model.missed(turn);
  EXPECT_NEAR(so3_log(model.last().rotation()).y(), 0.15, 1e-12);
}

TEST(MotionModel, AKnownTurnTakesThePlaceOfTheForetoldOne) {
  MotionModel model{MotionOptions()};
  model.reset(SE3(), {0});
  model.measured(SE3::exp((Vector6d() << 0.01, 0, 0, 0, 0.02, 0).finished()), {kFrame});
  const SE3 turn(so3_exp({0.1, 0, -0.2}), Eigen::Vector3d::Zero());
  const SE3 step = model.predicted_step({2 * kFrame}, turn);
  EXPECT_TRUE(step.rotation().isApprox(turn.rotation()));
  EXPECT_GT(step.translation().norm(), 0.002);
}

TEST(CorrectTranslation, APointInTheMiddleMovesAsSeenAndTheTurnStays) {
  const CameraPtr camera = *make_camera({CameraModel::kPinholeRadtan, 640, 480, {525, 525, 319.5, 239.5}});
  constexpr double kDepth = 2;
  const SE3 step(so3_exp({0.02, -0.05, 0.1}), {0.01, 0, 0.02});
  TinyMotion seen;
  seen.shift = {2, -1};  // tiny px
  const SE3 moved = correct_translation(step, seen, *camera, kDepth);
  EXPECT_TRUE(moved.rotation().isApprox(step.rotation()));
  const Eigen::Vector2d center(319.5, 239.5);
  const auto pixel = camera->project(moved * (kDepth * camera->unproject(center)));
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - center - Eigen::Vector2d(32, -16)).norm(), 2);
}

TEST(MotionModel, ALeapIsWhatNoHandCanDo) {
  constexpr double kDepth = 0.5;
  MotionModel model{MotionOptions()};
  model.reset(SE3(), {0});
  const auto leaps = [&](double metres, int frames) {
    const SE3 pose(Eigen::Quaterniond::Identity(), {0, metres, 0});
    return model.is_leap(pose, SE3(), Timestamp{frames * kFrame}, kDepth);
  };
  constexpr double k2g = 2 * 9.81 / (30 * 30);
  constexpr double k5g = 5 * 9.81 / (30 * 30);
  EXPECT_FALSE(leaps(k2g, 1));
  EXPECT_TRUE(leaps(k5g, 1));
  EXPECT_FALSE(leaps(k5g, 2)) << "a frame was dropped";
  EXPECT_TRUE(leaps(4 * k5g, 2));
  EXPECT_FALSE(leaps(k2g, 0)) << "the noise of poses";
  EXPECT_FALSE(model.is_leap(SE3(Eigen::Quaterniond::Identity(), {0, k5g, 0}), SE3(), {kFrame}, 4 * kDepth))
      << "what is far away moves little";
}

TEST(MotionModel, LongGapsAreNotExtrapolated) {
  MotionModel model{MotionOptions()};
  model.reset(SE3(), {0});
  model.measured(SE3::exp((Vector6d() << 0.01, 0, 0, 0, 0, 0).finished()), {kFrame});
  const double step = model.predicted_step({kFrame + 60'000'000'000}).translation().norm();
  EXPECT_LE(step, 0.2 * model.velocity().norm() + 1e-12);
}

/// The motion of the tiny image that a camera step causes at a depth, from the two points that correct_step
/// looks at.
TinyMotion tiny_motion_of(const SE3& step, const Camera& camera, double depth) {
  const Eigen::Vector2d center(319.5, 239.5);
  const auto moved = [&](double dx) {
    return *camera.project(step * (depth * camera.unproject(center + Eigen::Vector2d(dx, 0))));
  };
  const Eigen::Vector2d left = moved(-80);
  const Eigen::Vector2d right = moved(80);
  TinyMotion motion;
  motion.shift = (((left + right) / 2 - center) / 16).cast<float>();
  const Eigen::Vector2d across = right - left;
  motion.angle = static_cast<float>(std::atan2(across.y(), across.x()));
  return motion;
}

TEST(CorrectStep, LeavesAStepThatExplainsTheImageMotion) {
  const auto camera = test_camera();
  const double depth = 1.2;
  const SE3 step = SE3::exp((Vector6d() << 0.02, -0.01, 0.0, 0.005, 0.01, 0.02).finished());
  const SE3 corrected =
      correct_step(step, tiny_motion_of(step, *camera, depth), *camera, depth, StepCorrectionOptions());
  EXPECT_LT((corrected * step.inverse()).log().norm(), 2e-3);
}

TEST(CorrectStep, FindsARotationThatThePredictionMissed) {
  const auto camera = test_camera();
  for (const double angle : {-0.05, -0.02, 0.02, 0.05}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vector6d xi = Vector6d::Zero();
      xi(3 + axis) = angle;
      const SE3 truth = SE3::exp(xi);
      const SE3 corrected =
          correct_step(SE3(), tiny_motion_of(truth, *camera, 1.0), *camera, 1.0, StepCorrectionOptions());
      EXPECT_LT((corrected * truth.inverse()).log().norm(), 0.1 * std::abs(angle)) << "axis " << axis;
    }
  }
}

}  // namespace
}  // namespace cairn
