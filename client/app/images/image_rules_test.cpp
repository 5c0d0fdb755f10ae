// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/app/images/image_choice.h"
#include "client/app/images/image_demand.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr MonotonicTime kStart{1h};

/// Frames that are sent of those of so many milliseconds.
int sent(ImageDemand& demand, MonotonicTime from, std::chrono::microseconds step, int frames) {
  int count = 0;
  for (int i = 0; i < frames; ++i) count += demand.take_turn(from + i * step) ? 1 : 0;
  return count;
}

TEST(ImageDemand, NothingIsSentUnlessSomebodyAsksForThisCamera) {
  ImageDemand demand("shoulder");
  EXPECT_FALSE(demand.take_turn(kStart));
  demand.hear({"hand", "other"}, kStart);
  EXPECT_FALSE(demand.take_turn(kStart));
  demand.hear({"hand", "shoulder"}, kStart);
  EXPECT_TRUE(demand.take_turn(kStart));
  EXPECT_THAT(demand.askers(kStart), ElementsAre("hand"));
  demand.hear({"hand", ""}, kStart + 1ms);
  EXPECT_FALSE(demand.is_asked(kStart + 1ms)) << "it said that it wants none any more";
}

TEST(ImageDemand, WhoFallsSilentAsksNoMore) {
  ImageDemand demand("shoulder");
  demand.hear({"hand", "shoulder"}, kStart);
  EXPECT_TRUE(demand.is_asked(kStart + 2 * kPictureRequestPeriod)) << "a request may be lost";
  EXPECT_FALSE(demand.is_asked(kStart + 1s));
  EXPECT_THAT(demand.askers(kStart + 1s), IsEmpty());
}

TEST(ImageDemand, TenASecondWhateverTheCameraGives) {
  for (const auto& [step, least] : {std::pair{8'333us, 99}, {16'667us, 99}, {33'333us, 97}, {40'000us, 97}}) {
    ImageDemand demand("shoulder");
    int count = 0;
    for (int second = 0; second < 10; ++second) {
      const auto now = kStart + second * 1s;
      for (auto t = now; t < now + 1s; t += step) {
        demand.hear({"hand", "shoulder"}, t);
        count += demand.take_turn(t) ? 1 : 0;
      }
    }
    EXPECT_GE(count, least) << step.count();
    EXPECT_LE(count, 101) << step.count();
  }
}

TEST(ImageDemand, APauseIsNotCaughtUpWith) {
  ImageDemand demand("shoulder");
  demand.hear({"hand", "shoulder"}, kStart);
  EXPECT_TRUE(demand.take_turn(kStart));
  demand.hear({"hand", "shoulder"}, kStart + 5s);
  EXPECT_LE(sent(demand, kStart + 5s, 1ms, 100), 2);
}

TEST(ImageDemand, ManyNamesAskForNoMoreImagesAndTakeNoMemory) {
  ImageDemand demand("shoulder");
  for (int i = 0; i < 1000; ++i) demand.hear({"viewer-" + std::to_string(i), "shoulder"}, kStart);
  EXPECT_LE(demand.askers(kStart).size(), 16U);
  demand.hear({"hand", "shoulder"}, kStart + 2s);
  EXPECT_THAT(demand.askers(kStart + 2s), ElementsAre("hand")) << "those are silent";
}

class Choice : public ::testing::Test {
 protected:
  void come(const std::string& name) { choice_.come({name, 640, 480}); }
  void image(const std::string& name, MonotonicTime now) {
    wire::CameraPicture image;
    image.name = name;
    image.state = TrackingState::kTracking;
    image.map = "kitchen";
    choice_.receive(image, cv::Mat(48, 64, CV_8UC3, cv::Scalar(1, 2, 3)), now);
  }
  ImageChoice choice_{"hand"};
};

TEST_F(Choice, TheCamerasAreTheOthers) {
  come("hand");
  EXPECT_THAT(choice_.cameras(), IsEmpty());
  come("shoulder");
  come("head");
  EXPECT_THAT(choice_.cameras(), ElementsAre("head", "shoulder"));
  choice_.gone("head");
  EXPECT_THAT(choice_.cameras(), ElementsAre("shoulder"));
}

TEST_F(Choice, ARequestIsSaidAgainWhileItHoldsAndOnceThatItDoesNot) {
  EXPECT_FALSE(choice_.request(kStart));
  choice_.choose("shoulder", kStart);
  EXPECT_EQ(choice_.request(kStart).value_or(wire::PictureRequest()).camera, "shoulder");
  EXPECT_FALSE(choice_.request(kStart + 1ms));
  EXPECT_TRUE(choice_.request(kStart + kPictureRequestPeriod));
  choice_.choose("", kStart + 300ms);
  const auto last = choice_.request(kStart + 300ms);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->camera, "");
  EXPECT_EQ(last->name, "hand");
  EXPECT_FALSE(choice_.request(kStart + 1s));
}

TEST_F(Choice, WhatIsShownSaysWhetherItIsOfNow) {
  choice_.choose("shoulder", kStart);
  EXPECT_THAT(describe(choice_.view(kStart)), HasSubstr("is not there"));
  come("shoulder");
  EXPECT_TRUE(is_stale(choice_.view(kStart)));
  EXPECT_THAT(describe(choice_.view(kStart)), HasSubstr("is asked for"));
  EXPECT_THAT(describe(choice_.view(kStart + 2s)), HasSubstr("no image for 2 s"));
  image("head", kStart);
  EXPECT_TRUE(choice_.view(kStart).pixels.empty()) << "of another than is wanted";
  image("shoulder", kStart + 2s);
  EXPECT_FALSE(is_stale(choice_.view(kStart + 3s)));
  EXPECT_EQ(describe(choice_.view(kStart + 3s)), "shoulder: tracking, kitchen");
  EXPECT_TRUE(is_stale(choice_.view(kStart + 3001ms)));
  EXPECT_THAT(describe(choice_.view(kStart + 5s)), HasSubstr("STOPPED, the image is 3 s old"));
  choice_.gone("shoulder");
  EXPECT_THAT(describe(choice_.view(kStart + 3s)), HasSubstr("has gone"));
  choice_.choose("head", kStart + 6s);
  EXPECT_TRUE(choice_.view(kStart + 6s).pixels.empty()) << "another camera's is not shown under this name";
}

}  // namespace
}  // namespace cairn
