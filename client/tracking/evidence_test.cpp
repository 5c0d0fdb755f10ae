// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/evidence.h"

#include <gtest/gtest.h>

#include "client/tracking/tracker_options.h"

namespace cairn {
namespace {

const TrackerOptions kOptions;

FrameEvidence seen(PoseVerdict share, int found, float quality) {
  return {true, share, found, quality, false, false};
}

PoseVerdict by_motion(const FrameEvidence& evidence, const RecoveryState& state) {
  return judge_frame(evidence, PoseOrigin::kMotion, state, kOptions);
}

TEST(Evidence, WithoutAPoseThereIsNothing) {
  EXPECT_EQ(by_motion({}, Tracking{}), PoseVerdict::kBad);
}

TEST(Evidence, WhileItTracksTheShareDecides) {
  for (const PoseVerdict share : {PoseVerdict::kGood, PoseVerdict::kPoor, PoseVerdict::kBad})
    EXPECT_EQ(by_motion(seen(share, 30, 0.2F), Tracking{0.8F}), share);
}

TEST(Evidence, APoorPoseMustNotLeapNorComeOutOfACut) {
  FrameEvidence leap = seen(PoseVerdict::kPoor, kOptions.evidence.enough_points - 1, 0.2F);
  leap.is_leap = true;
  EXPECT_EQ(by_motion(leap, Tracking{0.8F}), PoseVerdict::kBad);
  leap.found = kOptions.evidence.enough_points;
  EXPECT_EQ(by_motion(leap, Tracking{0.8F}), PoseVerdict::kPoor);
  FrameEvidence cut = seen(PoseVerdict::kPoor, 200, 0.2F);
  cut.is_cut = true;
  EXPECT_EQ(by_motion(cut, Tracking{0.8F}), PoseVerdict::kBad);
  cut.share = PoseVerdict::kGood;
  EXPECT_EQ(by_motion(cut, Tracking{0.8F}), PoseVerdict::kGood);
}

/// After a frame that failed the prediction is a guess: most of what was found before must be found again, at
/// most as much as of a place that nothing else speaks for.
TEST(Evidence, AfterAFailureMostMustBeFoundAgain) {
  const Tracking failed{0.4F, 1, false};
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, 40, 0.27F), failed), PoseVerdict::kBad);
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, 40, 0.29F), failed), PoseVerdict::kGood);
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, kOptions.recovery.fewest_points - 1, 0.9F), failed),
            PoseVerdict::kBad);
  const Tracking rich{1.0F, 1, false};
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, 40, kOptions.recovery.verified_quality), rich),
            PoseVerdict::kGood);
}

TEST(Evidence, WhatIsFollowedOrRecognizedIsPoorAtLeast) {
  const FrameEvidence few = seen(PoseVerdict::kBad, kOptions.evidence.enough_points, 0.11F);
  EXPECT_EQ(judge_frame(few, PoseOrigin::kFlow, Tracking{0.8F}, kOptions), PoseVerdict::kPoor);
  EXPECT_EQ(judge_frame(few, PoseOrigin::kCorners, Tracking{0.8F}, kOptions), PoseVerdict::kBad);
  const FrameEvidence more = seen(PoseVerdict::kBad, kOptions.recovery.fewest_points, 0.41F);
  EXPECT_EQ(judge_frame(more, PoseOrigin::kFlow, Tracking{0.8F}, kOptions), PoseVerdict::kBad);
  EXPECT_EQ(judge_frame(more, PoseOrigin::kCorners, Tracking{0.8F}, kOptions), PoseVerdict::kPoor);
}

TEST(Evidence, WhileItIsVerifiedEachFrameMustShowWhatWasAskedFor) {
  Verifying verification;
  verification.needed_quality = 0.4F;
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, 100, 0.39F), verification), PoseVerdict::kBad);
  EXPECT_EQ(by_motion(seen(PoseVerdict::kGood, 100, 0.41F), verification), PoseVerdict::kGood);
}

TEST(Evidence, ASoundPoseIsGoodOrHasManyPoints) {
  EXPECT_TRUE(is_sound(seen(PoseVerdict::kGood, 10, 0.5F), PoseVerdict::kGood, kOptions));
  EXPECT_TRUE(is_sound(seen(PoseVerdict::kPoor, kOptions.evidence.enough_points, 0.2F), PoseVerdict::kPoor,
                       kOptions));
  EXPECT_FALSE(is_sound(seen(PoseVerdict::kPoor, kOptions.evidence.enough_points - 1, 0.2F),
                        PoseVerdict::kPoor, kOptions));
  EXPECT_FALSE(is_sound(seen(PoseVerdict::kPoor, 200, kOptions.lost_quality), PoseVerdict::kPoor, kOptions));
}

}  // namespace
}  // namespace cairn
