// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/gravity.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "common/geometry/se3.h"
#include "server/relocalization/exact_map.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

const GravityOptions kOptions;

using testing::describe_image;
using testing::ExactMap;
using testing::Scene;

constexpr double kSigma = 0.02;
constexpr double kDegree = std::numbers::pi / 180;

/// Keyframes held in all ways, in a map where up is `up_`.
class UpInMapTest : public ::testing::Test {
 protected:
  UpInMapTest() {
    auto keyframes = std::make_shared<KeyframeBlock>();
    for (uint64_t id = 1; id <= 12; ++id) {
      KeyframePose& keyframe = keyframes->keyframes.emplace_back();
      keyframe.id = KeyframeId{id};
      keyframe.camera_from_map = SE3(Eigen::Quaterniond::UnitRandom(), {0, 0, 0});
      keyframes->live |= uint64_t{1} << (id - 1);
      KeyframeView view;
      view.id = keyframe.id;
      view.up = turned(keyframe.camera_from_map.rotation(), {up_, kSigma});
      views_.push_back(view);
    }
    snapshot_.keyframe_blocks = {keyframes};
  }
  [[nodiscard]] double error(const UpDirection& found) const { return angle_between(found, {up_, 0}); }
  /// Measures `degrees` beside the truth.
  void falsify(KeyframeView* view, double degrees) {
    const Eigen::Vector3d axis = view->up->up.unitOrthogonal();
    view->up->up = Eigen::AngleAxisd(degrees * kDegree, axis) * view->up->up;
  }

  const Eigen::Vector3d up_ = Eigen::Vector3d(0.2, -0.9, 0.3).normalized();
  MapSnapshot snapshot_;
  std::vector<KeyframeView> views_;
};

TEST_F(UpInMapTest, IsWhatTheKeyframesMeasuredHoweverTheyWereHeld) {
  const auto found = up_in_map(snapshot_, views_, kOptions);
  ASSERT_TRUE(found);
  EXPECT_LT(error(*found), 1e-9);
  EXPECT_LE(found->sigma, kSigma);
  EXPECT_GE(found->sigma, 0.01) << "what an accelerometer is off by does not average out";
}

TEST_F(UpInMapTest, IsNotKnownWhereNoKeyframeMeasuredIt) {
  for (KeyframeView& view : views_) view.up.reset();
  EXPECT_FALSE(up_in_map(snapshot_, views_, kOptions));
  EXPECT_FALSE(up_in_map(snapshot_, {}, kOptions));
}

TEST_F(UpInMapTest, OneThatIsWrongHasNoPartInIt) {
  falsify(&views_[3], 60);
  const auto found = up_in_map(snapshot_, views_, kOptions);
  ASSERT_TRUE(found);
  EXPECT_LT(error(*found), 1e-9);
}

TEST_F(UpInMapTest, WhereManyContradictTheRestNothingIsKnown) {
  for (size_t i = 0; i < views_.size(); i += 2) falsify(&views_[i], 90);
  EXPECT_FALSE(up_in_map(snapshot_, views_, kOptions));
}

TEST(IsUpright, WhatChanceAllowsIsAllowedAndNoMore) {
  const SE3 pose(Eigen::Quaterniond::UnitRandom(), {1, 2, 3});
  const UpDirection in_map{Eigen::Vector3d::UnitZ(), 0.01};
  const UpDirection seen = turned(pose.rotation(), {Eigen::Vector3d::UnitZ(), kSigma});
  const auto off_by = [&](double sigmas) {
    const double sigma = std::sqrt(0.01 * 0.01 + kSigma * kSigma + kOptions.pose_tilt * kOptions.pose_tilt);
    UpDirection other = seen;
    other.up = Eigen::AngleAxisd(sigmas * sigma, seen.up.unitOrthogonal()) * seen.up;
    return is_upright(pose, in_map, other, kOptions);
  };
  EXPECT_TRUE(off_by(0));
  EXPECT_TRUE(off_by(3.6));  // the square root of 13.8 is 3.72
  EXPECT_FALSE(off_by(3.8));
  GravityOptions wider;
  wider.chi_square = 16 * 16;
  UpDirection far_off = seen;
  far_off.up = Eigen::AngleAxisd(0.4, seen.up.unitOrthogonal()) * seen.up;
  EXPECT_FALSE(is_upright(pose, in_map, far_off, kOptions));
  EXPECT_TRUE(is_upright(pose, in_map, far_off, wider));
  EXPECT_TRUE(is_upright(pose, std::nullopt, seen, kOptions));
  EXPECT_TRUE(is_upright(pose, in_map, std::nullopt, kOptions));
}

/// A place that fits the image is the answer where the camera was held as it says, and is neither that nor
/// a rival where it was not.
TEST(RelocalizerWithGravity, APlaceInWhichTheCameraIsHeldOtherwiseIsNoCandidate) {
  const Scene scene(11);
  const ExactMap exact(scene, 1, {0, 4, 8});
  std::vector<KeyframeView> views = exact.views();
  const std::array steps{0, 4, 8};
  for (size_t i = 0; i < views.size(); ++i)
    views[i].up = turned(Scene::pose(steps[i]).rotation(), {-Eigen::Vector3d::UnitY(), kSigma});
  PlaceIndex index;
  index.put(index_map(nullptr, exact.snapshot(), views, kOptions));
  PlaceView view = describe_image(scene.render(Scene::pose(5), 100)->view());
  EXPECT_EQ(relocalize(index, *scene.camera(), view, RelocOptions()).verdict,
            RelocalizationVerdict::kConfirmed)
      << "it does not say";
  view.up = turned(Scene::pose(5).rotation(), {-Eigen::Vector3d::UnitY(), kSigma});
  EXPECT_EQ(relocalize(index, *scene.camera(), view, RelocOptions()).verdict,
            RelocalizationVerdict::kConfirmed);
  view.up->up = Eigen::AngleAxisd(20 * kDegree, Eigen::Vector3d::UnitZ()) * view.up->up;
  const RelocalizationAnswer answer = relocalize(index, *scene.camera(), view, RelocOptions());
  EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown);
  ASSERT_FALSE(answer.candidates.empty());
  EXPECT_NE(answer.candidates.front().reason.find("held otherwise"), std::string::npos)
      << answer.candidates.front().reason;
}

}  // namespace
}  // namespace cairn
