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

using ::testing::HasSubstr;
using ::testing::IsEmpty;

CameraPtr simple_camera(double focal) {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {focal, focal, 320, 240, 0, 0, 0, 0, 0}});
}

CameraDoubt doubt_of(uint8_t client) {
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

TEST(MapCamera, IsKnownWhenEstimatesOfMoreAndMoreKeyframesAgree) {
  MapCamera camera = make_map_camera(simple_camera(500), doubt_of(1));
  for (const size_t keyframes : {9, 10, 11}) {
    update(&camera, found(camera, 520, 0.02), keyframes);
    EXPECT_FALSE(camera.frozen) << keyframes;
  }
  MapCamera moving = camera;
  update(&moving, found(camera, 530, 0.02), 12);
  EXPECT_FALSE(moving.frozen) << "2 % from the estimate before";
  MapCamera unsure = camera;
  update(&unsure, found(camera, 520, 0.03), 12);
  EXPECT_FALSE(unsure.frozen);
  MapCamera again = camera;
  update(&again, found(camera, 520, 0.02), 11);
  EXPECT_FALSE(again.frozen) << "the same keyframes tell the same again";
  update(&camera, found(camera, 520, 0.02), 12);
  EXPECT_TRUE(camera.frozen);
}

TEST(MapCamera, WhatHoldsItIsNotTakenForKnowledge) {
  MapCamera camera = make_map_camera(simple_camera(500), doubt_of(1));
  const double at_its_end = 500 * std::exp(2.9 * 0.35);
  for (size_t keyframes = 3; keyframes < 60; ++keyframes)
    update(&camera, found(camera, at_its_end, 0.01), keyframes);
  EXPECT_FALSE(camera.frozen);
  EXPECT_TRUE(cannot_be_known(camera));
}

TEST(MapCamera, WhatCouldNotBeJudgedIsAsUncertainAsBefore) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double sigma : {std::nan(""), infinity, 7.0}) {
    MapCamera camera = make_map_camera(simple_camera(500), doubt_of(1));
    for (size_t keyframes = 3; keyframes < 20; ++keyframes)
      update(&camera, found(camera, 520, sigma), keyframes);
    EXPECT_EQ(camera.sigma, camera.prior_sigma) << sigma;
    EXPECT_FALSE(camera.frozen) << sigma;
  }
}

TEST(MapCamera, AMoveThatIsSeenMakesAVersionAndNoOther) {
  MapCamera camera = make_map_camera(simple_camera(500), doubt_of(1));
  EXPECT_EQ(publish(&camera), Publication::kNone);
  EXPECT_EQ(camera.version.version, 1U);
  update(&camera, found(camera, 500.05, 0.34), 3);  // 0.04 px in the corners
  EXPECT_EQ(publish(&camera), Publication::kNone);
  EXPECT_EQ(camera.version.version, 1U);
  update(&camera, found(camera, 500.05, 0.1), 4);
  EXPECT_EQ(publish(&camera), Publication::kKnownBetter);
  EXPECT_EQ(camera.published->focal_length(), 500) << "what nobody sees needs no new patches";
  update(&camera, found(camera, 510, 0.1), 5);
  EXPECT_EQ(publish(&camera), Publication::kMoved);
  EXPECT_EQ(camera.published->focal_length(), 510);
  EXPECT_EQ(camera.version.version, 3U);
}

/// A map of keyframes alone.
class ManyCameras : public ::testing::Test {
 protected:
  /// Each camera with one keyframe; the one at `known` is known, that of `bare` has lost its keyframe.
  [[nodiscard]] static MapState make(int known, int bare) {
    std::vector<MapKeyframe> keyframes;
    std::vector<MapCamera> cameras;
    for (int i = 0; i < static_cast<int>(kMaxCamerasFoundOut); ++i) {
      cameras.push_back(make_map_camera(simple_camera(500 + i), doubt_of(static_cast<uint8_t>(i + 1))));
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

TEST_F(ManyCameras, NoMoreAreTakenInThanARevisionNames) {
  EXPECT_FALSE(make(-1, -1).has_place_for_camera());
}

TEST_F(ManyCameras, OneThatIsKnownGivesUpItsPlaceAndItsKeyframeKeepsIt) {
  MapState map = make(7, -1);
  ASSERT_TRUE(map.has_place_for_camera());
  const CameraPtr known = map.keyframes()[7].camera;
  EXPECT_EQ(map.add_camera(simple_camera(800), doubt_of(200)), 7);
  EXPECT_EQ(map.keyframes()[7].camera, known);
  EXPECT_TRUE(map.has_known_camera(map.keyframes()[7]));
  EXPECT_EQ(map.camera_index(doubt_of(200)), 7);
  EXPECT_EQ(map.camera_index(doubt_of(8)), -1);
  EXPECT_EQ(map.cameras().size(), kMaxCamerasFoundOut);
}

TEST_F(ManyCameras, OneWithoutKeyframesGivesUpItsPlace) {
  MapState map = make(-1, 9);
  ASSERT_TRUE(map.has_place_for_camera());
  EXPECT_EQ(map.add_camera(simple_camera(800), doubt_of(200)), 9);
}

using CamerasOfAMap = testing::MapMakerFixture;

TEST_F(CamerasOfAMap, ARefusedKeyframeLeavesNone) {
  start();
  KeyframeInput refused = testing::make_offer(scene_, *maker_->snapshot(), testing::kSecondStep);
  refused.doubt = doubt_of(2);
  ASSERT_EQ(maker_->add_keyframe(refused).verdict, KeyframeVerdict::kTooClose);
  EXPECT_THAT(maker_->statistics().cameras, IsEmpty());
}

TEST_F(CamerasOfAMap, OneIsAdjustedByItsOwnKeyframesAndNotByThoseOfOthers) {
  start();
  for (const int step : {5, 8, 11}) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  input_.doubt = doubt_of(2);
  ASSERT_EQ(offer(14).verdict, KeyframeVerdict::kAccepted);
  adjust_globally();
  (void)maker_->snapshot();
  const auto cameras = maker_->statistics().cameras;
  ASSERT_EQ(cameras.size(), 1U);
  EXPECT_EQ(cameras[0].version.version, 1U);
  EXPECT_EQ(cameras[0].camera, scene_.camera()) << "one view tells nothing of it";
  EXPECT_EQ(cameras[0].sigma, input_.doubt->sigma);
}

}  // namespace
}  // namespace cairn
