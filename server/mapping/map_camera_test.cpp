// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/map/limits.h"
#include "server/mapping/adjustment.h"
#include "server/mapping/map_maker_fixture.h"

namespace cairn {
namespace {

const SelfCalibrationOptions kOptions;

using ::testing::ElementsAre;
using ::testing::IsEmpty;

CameraPtr simple_camera(double focal) {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {focal, focal, 320, 240, 0, 0, 0, 0, 0}});
}

CameraPrior prior_of(uint8_t client) {
  return {{ClientId{{client}}, 0, 1}, {0.35, 0.1}};
}

/// What an adjustment finds of a camera that began at 500 px.
FreeCamera found(const MapCamera& camera, double focal, double sigma) {
  FreeCamera adjusted{.camera = simple_camera(focal)};
  adjusted.prior_mean = camera.prior_mean;
  adjusted.prior_sigma = camera.prior_sigma;
  adjusted.covariance = Eigen::Matrix2d::Identity() * sigma * sigma;
  return adjusted;
}

/// None of them removed.
KeyframeCount all_of(size_t keyframes) {
  return {keyframes, keyframes};
}

TEST(MapCamera, IsKnownWhenEstimatesOfMoreAndMoreKeyframesAgree) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  for (const size_t keyframes : {11, 12, 13}) {
    update(&camera, found(camera, 520, 0.01), all_of(keyframes), kOptions);
    EXPECT_FALSE(camera.frozen) << keyframes;
  }
  MapCamera moving = camera;
  update(&moving, found(camera, 530, 0.01), all_of(14), kOptions);
  EXPECT_FALSE(moving.frozen) << "2 % from the estimates before";
  MapCamera unsure = camera;
  update(&unsure, found(camera, 520, 0.015), all_of(14), kOptions);
  EXPECT_FALSE(unsure.frozen);
  MapCamera again = camera;
  update(&again, found(camera, 520, 0.01), all_of(13), kOptions);
  EXPECT_FALSE(again.frozen) << "the same keyframes tell the same again";
  MapCamera unjudged = camera;
  FreeCamera moved_only = found(camera, 520, 0.01);
  moved_only.judge = false;
  update(&unjudged, moved_only, all_of(14), kOptions);
  EXPECT_FALSE(unjudged.frozen);
  MapCamera few = camera;
  update(&few, found(camera, 520, 0.01), {11, 14}, kOptions);
  EXPECT_FALSE(few.frozen) << "eleven are left";
  update(&camera, found(camera, 520, 0.01), {12, 14}, kOptions);
  EXPECT_TRUE(camera.frozen);
}

TEST(MapCamera, ADriftIsNoAgreement) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  double focal = 540;
  for (size_t keyframes = 3; keyframes < 40; ++keyframes, focal *= 0.996) {
    update(&camera, found(camera, focal, 0.01), all_of(keyframes), kOptions);
    EXPECT_FALSE(camera.frozen) << "1.2 % over four, at " << keyframes;
  }
}

TEST(MapCamera, WhatWasBelievedToBeginWithTakesMoreKeyframesToBeKnown) {
  CameraPrior believed = prior_of(1);
  believed.sigma = {0.005, 0.05};
  MapCamera camera = make_map_camera(simple_camera(500), believed);
  for (size_t keyframes = 3; keyframes < 20; ++keyframes) {
    EXPECT_EQ(is_worth_judging(camera, all_of(keyframes), kOptions), keyframes >= 17) << keyframes;
    update(&camera, found(camera, 501, 0.004), all_of(keyframes), kOptions);
    EXPECT_FALSE(camera.frozen) << keyframes;
  }
  EXPECT_FALSE(is_worth_judging(camera, {10, 39}, kOptions));
  EXPECT_TRUE(is_worth_judging(camera, {10, 40}, kOptions)) << "or nobody would hear that it cannot be known";
  update(&camera, found(camera, 501, 0.004), all_of(20), kOptions);
  EXPECT_TRUE(camera.frozen);
}

TEST(MapCamera, ThatItCannotBeKnownIsSaidOfAMapWhoseKeyframesAreRemovedTooAndLookedAtMoreSeldom) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  for (size_t made = 3; made <= 40; ++made) {
    EXPECT_FALSE(cannot_be_known(camera, kOptions)) << made;
    ASSERT_TRUE(is_worth_judging(camera, {20, made}, kOptions));
    update(&camera, found(camera, 520, 0.2), {20, made}, kOptions);
    EXPECT_FALSE(is_worth_judging(camera, {20, made}, kOptions)) << "nothing is new";
  }
  EXPECT_TRUE(cannot_be_known(camera, kOptions));
  EXPECT_FALSE(is_worth_judging(camera, {20, 50}, kOptions));
  EXPECT_TRUE(is_worth_judging(camera, {20, 51}, kOptions)) << "the motion may have become another";
}

TEST(MapCamera, WhatHoldsItIsNotTakenForKnowledge) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  const double at_its_end = 500 * std::exp(2.9 * 0.35);
  for (size_t keyframes = 3; keyframes < 60; ++keyframes)
    update(&camera, found(camera, at_its_end, 0.01), all_of(keyframes), kOptions);
  EXPECT_FALSE(camera.frozen);
  EXPECT_TRUE(cannot_be_known(camera, kOptions));
}

TEST(MapCamera, WhatCouldNotBeJudgedIsAsUncertainAsBefore) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double sigma : {std::nan(""), infinity, 7.0}) {
    MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
    for (size_t keyframes = 3; keyframes < 20; ++keyframes)
      update(&camera, found(camera, 520, sigma), all_of(keyframes), kOptions);
    EXPECT_EQ(camera.sigma, camera.prior_sigma) << sigma;
    EXPECT_FALSE(camera.frozen) << sigma;
  }
}

TEST(MapCamera, AMoveThatIsSeenMakesAVersionAndNoOther) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  EXPECT_FALSE(publish(&camera, kOptions, PublicationOptions()));
  EXPECT_EQ(camera.version.version, 1U);
  update(&camera, found(camera, 500.05, 0.34), all_of(3), kOptions);  // 0.04 px in the corners
  EXPECT_FALSE(publish(&camera, kOptions, PublicationOptions()));
  EXPECT_EQ(camera.version.version, 1U);
  update(&camera, found(camera, 500.05, 0.1), all_of(4), kOptions);
  EXPECT_TRUE(publish(&camera, kOptions, PublicationOptions())) << "it is known better";
  EXPECT_EQ(camera.version.version, 2U);
  update(&camera, found(camera, 510, 0.1), all_of(5), kOptions);
  EXPECT_TRUE(publish(&camera, kOptions, PublicationOptions()));
  EXPECT_EQ(camera.published->focal_length(), 510);
  EXPECT_EQ(camera.version.version, 3U);
}

TEST(MapCamera, PatchesAreAimedAnewWhereASearchFeelsItAndOnceItIsKnown) {
  MapCamera camera = make_map_camera(simple_camera(500), prior_of(1));
  update(&camera, found(camera, 508, 0.1), all_of(3), kOptions);
  EXPECT_EQ(take_move(&camera, kOptions), CameraMove::kNone) << "1.6 %";
  update(&camera, found(camera, 511, 0.1), all_of(4), kOptions);
  EXPECT_EQ(take_move(&camera, kOptions), CameraMove::kFelt) << "2.2 %";
  update(&camera, found(camera, 515, 0.1), all_of(5), kOptions);
  EXPECT_EQ(take_move(&camera, kOptions), CameraMove::kNone) << "from there on";
  camera.frozen = true;
  EXPECT_EQ(take_move(&camera, kOptions), CameraMove::kSettled);
  EXPECT_EQ(take_move(&camera, kOptions), CameraMove::kNone);
}

/// A map of keyframes alone.
class ManyCameras : public ::testing::Test {
 protected:
  /// Each camera with one keyframe; the one at `known` is known, that of `bare` has lost its keyframe.
  [[nodiscard]] static MapState make(int known, int bare) {
    std::vector<MapKeyframe> keyframes;
    std::vector<MapCamera> cameras;
    for (int i = 0; i < static_cast<int>(kMaxCalibratedCameras); ++i) {
      cameras.push_back(make_map_camera(simple_camera(500 + i), prior_of(static_cast<uint8_t>(i + 1))));
      cameras.back().frozen = i == known;
      MapKeyframe k;
      k.id = KeyframeId{keyframes.size() + 1};
      k.camera = cameras.back().camera;
      k.estimated_camera = i;
      k.live = i != bare;
      keyframes.push_back(std::move(k));
    }
    return {std::move(keyframes), {}, std::move(cameras)};
  }
};

TEST_F(ManyCameras, NoMoreAreCalibratedThanARevisionNames) {
  MapState map = make(-1, -1);
  const CameraPtr first = map.keyframes()[0].camera;
  EXPECT_EQ(map.add_camera(simple_camera(800), prior_of(200)), 0) << "of fewest keyframes";
  EXPECT_EQ(map.cameras().size(), kMaxCalibratedCameras);
  EXPECT_EQ(map.keyframes()[0].camera, first);
  EXPECT_TRUE(map.has_known_camera(map.keyframes()[0])) << "as exact as it will be";
}

TEST_F(ManyCameras, AnAdjustmentOfACameraThatHasLostItsPlaceIsForgotten) {
  MapState map = make(7, -1);
  const CutCamera cut{7, map.cameras()[7].version, map.keyframes_of(7)};
  const FreeCamera adjusted = found(map.cameras()[7], 555, 0.1);
  ASSERT_EQ(map.add_camera(simple_camera(800), prior_of(200)), 7);
  map.update_camera(cut, adjusted, kOptions);
  EXPECT_EQ(map.cameras()[7].camera->focal_length(), 800);
}

TEST_F(ManyCameras, OneThatIsKnownGivesUpItsPlaceAndItsKeyframeKeepsIt) {
  MapState map = make(7, -1);
  const CameraPtr known = map.keyframes()[7].camera;
  EXPECT_EQ(map.add_camera(simple_camera(800), prior_of(200)), 7);
  EXPECT_EQ(map.keyframes()[7].camera, known);
  EXPECT_TRUE(map.has_known_camera(map.keyframes()[7]));
  EXPECT_EQ(map.camera_index(prior_of(200)), 7);
  EXPECT_EQ(map.camera_index(prior_of(8)), -1);
  EXPECT_EQ(map.cameras().size(), kMaxCalibratedCameras);
}

TEST_F(ManyCameras, OneWithoutKeyframesGivesUpItsPlace) {
  MapState map = make(-1, 9);
  EXPECT_EQ(map.add_camera(simple_camera(800), prior_of(200)), 9);
}

TEST(CamerasOfAMapOfMany, OnlyThoseWithMostNewKeyframesAreAdjustedAndJudged) {
  std::vector<MapKeyframe> keyframes;
  std::vector<MapCamera> cameras;
  for (const size_t count : {4, 6, 2, 5, 7, 3}) {
    cameras.push_back(make_map_camera(simple_camera(500), prior_of(static_cast<uint8_t>(count))));
    for (size_t i = 0; i < count; ++i) {
      MapKeyframe k;
      k.id = KeyframeId{keyframes.size() + 1};
      k.camera = cameras.back().camera;
      k.estimated_camera = static_cast<int>(cameras.size()) - 1;
      keyframes.push_back(std::move(k));
    }
  }
  cameras[4].judged_keyframes = 7;  // nothing is new
  const MapProblem problem = global_problem({std::move(keyframes), {}, std::move(cameras)}, kOptions);
  std::vector<int> adjusted;
  for (const CutCamera& cut : problem.cameras) adjusted.push_back(cut.index);
  EXPECT_THAT(adjusted, ElementsAre(0, 1, 3, 5)) << "two views hardly tell a focal length";
  std::vector<int> judged;
  for (size_t i = 0; i < problem.cameras.size(); ++i) {
    if (problem.bundle.free_cameras[i].judge) judged.push_back(problem.cameras[i].index);
  }
  EXPECT_THAT(judged, ElementsAre(1, 3));
}

using CamerasOfAMap = testing::MapMakerFixture;

TEST_F(CamerasOfAMap, ARefusedKeyframeLeavesNone) {
  start();
  KeyframeInput refused = testing::make_offer(scene_, *maker_->snapshot(), testing::kSecondStep);
  refused.prior = prior_of(2);
  ASSERT_EQ(maker_->add_keyframe(refused).verdict, KeyframeVerdict::kTooClose);
  EXPECT_THAT(maker_->statistics().cameras, IsEmpty());
}

TEST_F(CamerasOfAMap, OneIsAdjustedByItsOwnKeyframesAndNotByThoseOfOthers) {
  start();
  for (const int step : {5, 8, 11}) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  input_.prior = prior_of(2);
  ASSERT_EQ(offer(14).verdict, KeyframeVerdict::kAccepted);
  adjust_globally();
  (void)maker_->snapshot();
  const auto cameras = maker_->statistics().cameras;
  ASSERT_EQ(cameras.size(), 1U);
  EXPECT_EQ(cameras[0].version.version, 1U);
  EXPECT_EQ(cameras[0].camera, scene_.camera()) << "one view tells nothing of it";
  EXPECT_EQ(cameras[0].sigma, input_.prior->sigma);
}

}  // namespace
}  // namespace cairn
