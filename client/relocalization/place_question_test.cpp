// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/place_question.h"

#include <gtest/gtest.h>

#include "client/tracking/plane_scene.h"

namespace cairn {
namespace {

constexpr int64_t kMillisecond = 1'000'000;

/// A picture with the corners of its `share` from the left; the rest is grey.
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

class PlaceQuestionTest : public ::testing::Test {
 protected:
  const FrameImages full_ = view_of(1);
  const FrameImages poor_ = view_of(0.1);
  PlaceQuestion question_;
};

TEST_F(PlaceQuestionTest, OneIsUnderWayAndFifteenASecondAreAsked) {
  int asked = 0;
  for (int64_t t = 0; t < 1000; t += 10) {
    if (!question_.ask(full_, at(t))) continue;
    ++asked;
    EXPECT_EQ(question_.ask(full_, at(t + 5)), nullptr) << "one is under way";
    (void)question_.answered(std::nullopt);
  }
  EXPECT_GE(asked, 13);
  EXPECT_LE(asked, 16);
}

TEST_F(PlaceQuestionTest, AnAnswerIsAwaitedForHalfASecond) {
  ASSERT_NE(question_.ask(full_, at(0)), nullptr);
  EXPECT_EQ(question_.ask(full_, at(450)), nullptr);
  EXPECT_FALSE(question_.nobody_answers());
  EXPECT_NE(question_.ask(full_, at(550)), nullptr);
  EXPECT_TRUE(question_.nobody_answers());
  question_.left_open();
  EXPECT_FALSE(question_.nobody_answers());
}

/// A recording that begins again.
TEST_F(PlaceQuestionTest, AQuestionFromTheFutureIsAnOldOne) {
  ASSERT_NE(question_.ask(full_, at(10'000)), nullptr);
  EXPECT_NE(question_.ask(full_, at(0)), nullptr);
}

TEST_F(PlaceQuestionTest, OnlyAPictureWithMuchToSeeSaysThatTheCameraIsElsewhere) {
  const auto poor = question_.ask(poor_, at(0));
  ASSERT_NE(poor, nullptr);
  ASSERT_LT(poor->corners.size(), 100U);
  (void)question_.answered(std::nullopt);
  EXPECT_FALSE(question_.is_elsewhere());
  const auto full = question_.ask(full_, at(100));
  ASSERT_NE(full, nullptr);
  ASSERT_GE(full->corners.size(), 100U);
  (void)question_.answered(std::nullopt);
  EXPECT_TRUE(question_.is_elsewhere());
  ASSERT_NE(question_.ask(poor_, at(200)), nullptr);
  (void)question_.answered(std::nullopt);
  EXPECT_TRUE(question_.is_elsewhere()) << "until it is proven where";
  question_.prove();
  EXPECT_FALSE(question_.is_elsewhere());
}

TEST_F(PlaceQuestionTest, AnAnswerAboutBeforeTheProofSaysNothingOfAfter) {
  ASSERT_NE(question_.ask(full_, at(0)), nullptr);
  question_.prove();
  (void)question_.answered(std::nullopt);
  EXPECT_FALSE(question_.is_elsewhere());
}

TEST_F(PlaceQuestionTest, NotKnownHoldsForASecondAndForFramesSinceTheBeginning) {
  ASSERT_NE(question_.ask(full_, at(1000)), nullptr);
  EXPECT_FALSE(question_.is_not_known(at(0), at(1000)));
  (void)question_.answered(std::nullopt);
  EXPECT_TRUE(question_.is_not_known(at(0), at(1900)));
  EXPECT_FALSE(question_.is_not_known(at(0), at(2100)));
  EXPECT_FALSE(question_.is_not_known(at(1001), at(1900))) << "it began after the question";
  ASSERT_NE(question_.ask(full_, at(1500)), nullptr);
  question_.left_open();
  EXPECT_TRUE(question_.is_not_known(at(0), at(1900))) << "what is left open changes nothing";
}

/// Suggested again and again where it does not show, a place counts as none known, but not as elsewhere.
TEST_F(PlaceQuestionTest, APlaceRefutedOftenIsNoNewsAnyMore) {
  MapSnapshot map;
  map.epoch = Epoch{1};
  PoseSuggestion place;
  place.epoch = Epoch{1};
  place.reference = KeyframeId{1};
  const CameraPtr camera =
      make_camera({CameraModel::kPinholeRadtan, 320, 240, {280, 280, 159.5, 119.5}}).value();
  bool is_news = true;
  int64_t t = 0;
  for (int i = 0; i < 100 && is_news; ++i, t += 100) {
    ASSERT_NE(question_.ask(full_, at(t)), nullptr);
    is_news = question_.answered(place);
    EXPECT_EQ(question_.suggests(map), is_news);
    (void)question_.take(full_, *camera, map);
    EXPECT_FALSE(question_.suggests(map)) << "tried once";
    question_.refute(at(t));
  }
  EXPECT_FALSE(is_news);
  EXPECT_FALSE(question_.is_elsewhere());
  question_.restart();
  ASSERT_NE(question_.ask(full_, at(t)), nullptr);
  EXPECT_FALSE(question_.answered(place)) << "who starts over is not led there again";
}

}  // namespace
}  // namespace cairn
