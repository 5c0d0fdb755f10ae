// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/keyframe_policy.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int kMany = 300;  // points found

class KeyframePolicyTest : public ::testing::Test {
 protected:
  /// Frames until one is offered, all with `found` points at `distance`; `most` at most.
  int frames_until_offer(int found, double distance, int most = 200) {
    for (int frame = 1; frame <= most; ++frame) {
      policy_.next_frame();
      if (policy_.wants(found, distance, false, [this] { return is_new_area_; })) return frame;
    }
    return most + 1;
  }
  bool is_new_area_ = true;
  const KeyframePolicyOptions options_{};
  const double soon_ = options_.distance * options_.need_distance;  // enough in need
  KeyframePolicy policy_{options_};
};

TEST_F(KeyframePolicyTest, AViewThatIsKnownWellIsOfferedFromTheFullDistanceOn) {
  EXPECT_GT(frames_until_offer(kMany, 0.99 * options_.distance), 200);
  EXPECT_LE(frames_until_offer(kMany, options_.distance), 1);
  EXPECT_EQ(frames_until_offer(kMany, options_.distance), options_.frames_between);
}

TEST_F(KeyframePolicyTest, WhereTheMapRunsOutLessDistanceIsEnough) {
  ASSERT_FALSE(policy_.wants(kMany, 0, false, [] { return true; }));
  EXPECT_GT(frames_until_offer(static_cast<int>(0.91 * kMany), soon_), 200);
  EXPECT_LE(frames_until_offer(static_cast<int>(0.89 * kMany), soon_), 1);
}

TEST_F(KeyframePolicyTest, WhatTheMapKnowsIsOfferedOnceFewPointsAreLeft) {
  is_new_area_ = false;
  ASSERT_FALSE(policy_.wants(kMany, 0, false, [] { return false; }));
  EXPECT_GT(frames_until_offer(static_cast<int>(0.71 * kMany), soon_), 200);
  EXPECT_LE(frames_until_offer(static_cast<int>(0.69 * kMany), soon_), 1);
}

// The answer costs half a millisecond, and in a view that stays as it is it is the same in each frame.
TEST_F(KeyframePolicyTest, AfterANoTheAreaIsLookedAtAgainOnlyWhereFewerPointsAreFound) {
  int looks = 0;
  const auto is_offered = [&](int found) {
    policy_.next_frame();
    return policy_.wants(found, soon_, false, [&] { return ++looks, is_new_area_; });
  };
  is_new_area_ = false;
  ASSERT_FALSE(is_offered(kMany));
  const int in_need = static_cast<int>(0.85 * kMany);
  for (int frame = 0; frame < 20; ++frame) EXPECT_FALSE(is_offered(in_need + frame % 2));
  EXPECT_EQ(looks, 1);
  EXPECT_FALSE(is_offered(in_need - 1));
  EXPECT_EQ(looks, 2);
  // What the map gained is lost again: another view than the one that was looked at.
  EXPECT_FALSE(is_offered(2 * kMany));
  is_new_area_ = true;
  EXPECT_TRUE(is_offered(static_cast<int>(0.85 * 2 * kMany)));
  EXPECT_EQ(looks, 3);
  // An offer may be refused: what was looked at before it says nothing of a later frame.
  int frames = 0;
  while (frames < 20 && !is_offered(static_cast<int>(0.7 * 2 * kMany))) ++frames;
  EXPECT_LT(frames, 20);
}

TEST_F(KeyframePolicyTest, WhatWidensAYoungMapIsOfferedSoonAndNotEveryFrame) {
  const double near = 0.1 * soon_;
  int offers = 0;
  for (int frame = 1; frame <= 20; ++frame) {
    policy_.next_frame();
    offers += policy_.wants(kMany, near, true, [this] { return is_new_area_; }) ? 1 : 0;
  }
  EXPECT_EQ(offers, 10);
  EXPECT_GT(frames_until_offer(kMany, near), 200);
}

// An offer may be refused: what was found at best before it is forgotten, and the next few points lost would
// make a frame too poor to build upon.
TEST_F(KeyframePolicyTest, WherePointsAreScarceItIsOfferedSoonWhateverWasFoundBefore) {
  const int scarce = options_.scarce_points - 1;
  EXPECT_LE(frames_until_offer(scarce, soon_), 5);
  EXPECT_LE(frames_until_offer(scarce, soon_), 5);
  EXPECT_GT(frames_until_offer(scarce, 0.99 * soon_), 200);
  EXPECT_GT(frames_until_offer(options_.scarce_points, soon_), 200);
}

}  // namespace
}  // namespace cairn
