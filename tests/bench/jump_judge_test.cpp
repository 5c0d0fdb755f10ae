// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/jump_judge.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Pose = SeenFrame::Pose;
constexpr SeenFrame kLost{Pose::kNone, false, false};
constexpr SeenFrame kVerifyingHere{Pose::kVerifying, true, true};
constexpr SeenFrame kVerifyingElsewhere{Pose::kVerifying, false, false};
constexpr SeenFrame kRight{Pose::kPublished, true, true};
constexpr SeenFrame kOff{Pose::kPublished, true, false};
constexpr SeenFrame kWrongMap{Pose::kPublished, false, false};

JumpOutcome judge(std::initializer_list<SeenFrame> frames) {
  return judge_jump(std::vector<SeenFrame>(frames));
}

TEST(JumpJudge, AVerifiedPoseCountsFromTheFirstFrameOfItsVerification) {
  const JumpOutcome o = judge({kLost, kVerifyingHere, kVerifyingHere, kRight, kRight});
  EXPECT_EQ(o.right, 1U);
  EXPECT_EQ(o.published, 3U);
  EXPECT_EQ(o.without, 3U);
  EXPECT_EQ(o.wrong_map + o.wrong_pose, 0U);
}

TEST(JumpJudge, AVerificationThatFailsSaysNothing) {
  const JumpOutcome o =
      judge({kVerifyingHere, kLost, kVerifyingElsewhere, kVerifyingHere, kVerifyingHere, kRight});
  EXPECT_EQ(o.right, 3U);
  EXPECT_EQ(o.published, 5U);
  const JumpOutcome never = judge({kVerifyingHere, kVerifyingHere, kLost});
  EXPECT_FALSE(never.right);
  EXPECT_FALSE(never.published);
  EXPECT_EQ(never.without, 3U);
}

TEST(JumpJudge, WrongPosesAreCountedAndDoNotCountAsFound) {
  const JumpOutcome o = judge({kWrongMap, kWrongMap, kOff, kVerifyingHere, kRight, kOff, kRight});
  EXPECT_EQ(o.wrong_map, 2U);
  EXPECT_EQ(o.wrong_pose, 2U);
  EXPECT_EQ(o.right, 3U);
  EXPECT_EQ(o.published, 4U);
  EXPECT_FALSE(judge({kWrongMap, kOff}).right);
}

TEST(JumpJudge, WrongPosesUnderVerificationDoNoHarm) {
  EXPECT_EQ(judge({kVerifyingElsewhere, kVerifyingElsewhere}).wrong_map, 0U);
}

TEST(Jumps, RowsAreReadInOrderAndDamageIsNamed) {
  const auto jumps = parse_jumps("# place frame time\nroom 615 1305031119.1\n\ndesk 7\n");
  ASSERT_TRUE(jumps);
  ASSERT_EQ(jumps->size(), 2U);
  EXPECT_EQ((*jumps)[0].place, "room");
  EXPECT_EQ((*jumps)[0].first_frame, 615U);
  EXPECT_EQ((*jumps)[1].place, "desk");
  const auto damaged = parse_jumps("room 1\nroom one\n");
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().code, ErrorCode::kDamaged);
  EXPECT_NE(damaged.error().message.find("room one"), std::string::npos);
}

}  // namespace
}  // namespace cairn
