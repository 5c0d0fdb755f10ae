// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/reloc_query_state.h"

#include <gtest/gtest.h>

#include "client/tracking/plane_scene.h"

namespace cairn {
namespace {

constexpr int64_t kMillisecond = 1'000'000;

/// An image with the corners of its `share` from the left; the rest is grey.
FrameImages view_of(double share) {
  const CameraPtr camera =
      make_camera({CameraModel::kPinholeRadtan, 320, 240, {280, 280, 159.5, 119.5}}).value();
  const test::PlaneScene scene(7, camera);
  const SE3 above(so3_exp({M_PI, 0, 0}), {0, 0, 0.5});
  GrayImage image(scene.render(above)->view());
  const auto width = static_cast<int>(share * image.width());
  for (int y = 0; y < image.height(); ++y) std::fill(image.row(y) + width, image.row(y) + image.width(), 128);
  FrameImages frame;
  frame.build_pyramid(image.view());
  frame.build_tiny();
  return frame;
}

Timestamp at(int64_t milliseconds) {
  return {milliseconds * kMillisecond};
}

class RelocQueryStateTest : public ::testing::Test {
 protected:
  const FrameImages full_ = view_of(1);
  const FrameImages poor_ = view_of(0.1);
  RelocQueryState query_{RelocQueryOptions()};
};

TEST_F(RelocQueryStateTest, OneIsUnderWayAndFifteenASecondAreAsked) {
  int asked = 0;
  for (int64_t t = 0; t < 1000; t += 10) {
    if (!query_.ask(full_, at(t))) continue;
    ++asked;
    EXPECT_EQ(query_.ask(full_, at(t + 5)), nullptr) << "one is under way";
    (void)query_.answered(std::nullopt);
  }
  EXPECT_GE(asked, 13);
  EXPECT_LE(asked, 16);
}

TEST_F(RelocQueryStateTest, AnAnswerIsAwaitedForHalfASecond) {
  ASSERT_NE(query_.ask(full_, at(0)), nullptr);
  EXPECT_EQ(query_.ask(full_, at(450)), nullptr);
  EXPECT_FALSE(query_.nobody_answers());
  EXPECT_NE(query_.ask(full_, at(550)), nullptr);
  EXPECT_TRUE(query_.nobody_answers());
  query_.left_open();
  EXPECT_FALSE(query_.nobody_answers());
}

/// A recording that begins again.
TEST_F(RelocQueryStateTest, AQueryFromTheFutureIsAnOldOne) {
  ASSERT_NE(query_.ask(full_, at(10'000)), nullptr);
  EXPECT_NE(query_.ask(full_, at(0)), nullptr);
}

TEST_F(RelocQueryStateTest, OnlyAnImageWithMuchToSeeSaysThatTheCameraIsElsewhere) {
  const auto poor = query_.ask(poor_, at(0));
  ASSERT_NE(poor, nullptr);
  ASSERT_LT(poor->corners.size(), 100U);
  (void)query_.answered(std::nullopt);
  EXPECT_FALSE(query_.is_elsewhere());
  const auto full = query_.ask(full_, at(100));
  ASSERT_NE(full, nullptr);
  ASSERT_GE(full->corners.size(), 100U);
  (void)query_.answered(std::nullopt);
  EXPECT_TRUE(query_.is_elsewhere());
  ASSERT_NE(query_.ask(poor_, at(200)), nullptr);
  (void)query_.answered(std::nullopt);
  EXPECT_TRUE(query_.is_elsewhere()) << "until it is verified where";
  query_.verified();
  EXPECT_FALSE(query_.is_elsewhere());
}

TEST_F(RelocQueryStateTest, AnAnswerAboutBeforeTheVerificationSaysNothingOfAfter) {
  ASSERT_NE(query_.ask(full_, at(0)), nullptr);
  query_.verified();
  (void)query_.answered(std::nullopt);
  EXPECT_FALSE(query_.is_elsewhere());
}

TEST_F(RelocQueryStateTest, NotKnownHoldsForASecondAndForFramesSinceTheBeginning) {
  ASSERT_NE(query_.ask(full_, at(1000)), nullptr);
  EXPECT_FALSE(query_.is_not_known(at(0), at(1000)));
  (void)query_.answered(std::nullopt);
  EXPECT_TRUE(query_.is_not_known(at(0), at(1900)));
  EXPECT_FALSE(query_.is_not_known(at(0), at(2100)));
  EXPECT_FALSE(query_.is_not_known(at(1001), at(1900))) << "it began after the query";
  ASSERT_NE(query_.ask(full_, at(1500)), nullptr);
  query_.left_open();
  EXPECT_TRUE(query_.is_not_known(at(0), at(1900))) << "what is left open changes nothing";
}

/// Suggested again and again where it does not show, a place counts as none known, but not as elsewhere.
TEST_F(RelocQueryStateTest, APlaceRejectedOftenIsNoNewsAnyMore) {
  MapSnapshot map;
  map.epoch = Epoch{1};
  PoseHypothesis place;
  place.epoch = Epoch{1};
  place.reference = KeyframeId{1};
  const CameraPtr camera =
      make_camera({CameraModel::kPinholeRadtan, 320, 240, {280, 280, 159.5, 119.5}}).value();
  bool is_news = true;
  int64_t t = 0;
  for (int i = 0; i < 100 && is_news; ++i, t += 100) {
    ASSERT_NE(query_.ask(full_, at(t)), nullptr);
    is_news = query_.answered(place);
    EXPECT_EQ(query_.has_hypothesis_in(map), is_news);
    (void)query_.take(full_, *camera, map);
    EXPECT_FALSE(query_.has_hypothesis_in(map)) << "tried once";
    query_.reject(at(t));
  }
  EXPECT_FALSE(is_news);
  EXPECT_FALSE(query_.is_elsewhere());
  query_.restart();
  ASSERT_NE(query_.ask(full_, at(t)), nullptr);
  EXPECT_FALSE(query_.answered(place)) << "who starts over is not led there again";
}

}  // namespace
}  // namespace cairn
