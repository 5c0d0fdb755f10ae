// SPDX-License-Identifier: Apache-2.0
#include "server/service/client_rates.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace cairn {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::HasSubstr;
using Judgement = ClientRates::Judgement;
using Kind = ClientRates::Kind;

constexpr MonotonicTime kStart{seconds(1000)};

TEST(TokenBucket, SoManyAtOnceAndThenSoManyASecond) {
  TokenBucket bucket(10, 3);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(bucket.take(kStart));
  EXPECT_FALSE(bucket.take(kStart));
  EXPECT_FALSE(bucket.take(kStart + milliseconds(99)));
  EXPECT_TRUE(bucket.take(kStart + milliseconds(100)));
  EXPECT_FALSE(bucket.take(kStart + milliseconds(100)));
  EXPECT_FALSE(bucket.take(kStart)) << "a clock that goes back gives nothing";
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(bucket.take(kStart + seconds(60))) << "no more is saved up";
  EXPECT_FALSE(bucket.take(kStart + seconds(60)));
}

TEST(TokenBucket, WithoutALimitAllAreWithinIt) {
  TokenBucket bucket(0, 0);
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(bucket.take(kStart));
}

TEST(ClientRatesTest, ATrackerIsNeverRefusedAlsoWhenItComesBackWithAllItKept) {
  ClientRates rates({});
  MonotonicTime now = kStart;
  for (int keyframe = 0; keyframe < 90; ++keyframe)
    ASSERT_EQ(rates.judge(Kind::kKeyframe, now), Judgement::kTake) << keyframe;
  for (int frame = 0; frame < 60 * 120; ++frame) {
    now += microseconds(16'667);
    ASSERT_EQ(rates.judge(Kind::kState, now), Judgement::kTake);
    if (frame % 20 == 0) {
      ASSERT_EQ(rates.judge(Kind::kKeyframe, now), Judgement::kTake);
    }
    if (frame % 6 == 0) {
      ASSERT_EQ(rates.judge(Kind::kQuery, now), Judgement::kTake);
    }
  }
}

TEST(ClientRatesTest, WhoSendsAHundredTimesAsMuchIsToldWhyAndMostlyPassedOver) {
  ClientRates rates({});
  std::map<Judgement, int> count;
  constexpr int kSeconds = 60;
  for (int i = 0; i < kSeconds * 300; ++i)
    ++count[rates.judge(Kind::kKeyframe, kStart + microseconds(i * 3'333))];
  EXPECT_LE(count[Judgement::kTake], 300 + 5 * kSeconds);
  EXPECT_GE(count[Judgement::kTake], 5 * (kSeconds - 1));
  EXPECT_GE(count[Judgement::kRefuse], kSeconds);
  EXPECT_LE(count[Judgement::kRefuse], 20 + 10 * kSeconds);
  EXPECT_GT(count[Judgement::kPassOver], kSeconds * 200);
  EXPECT_EQ(rates.judge(Kind::kQuery, kStart + seconds(60)), Judgement::kTake) << "of another kind";
  EXPECT_THAT(rates.why(Kind::kKeyframe), HasSubstr("takes 5 a second of one client (--keyframe-rate)"));
}

TEST(ClientRatesTest, AllThatATrackerKeptWhileItWasCutOffIsTakenAtOnce) {
  ClientRates rates({});
  constexpr int kSpool = 256;  // SessionOptions::spool_limit
  for (int i = 0; i < kSpool; ++i) ASSERT_EQ(rates.judge(Kind::kKeyframe, kStart), Judgement::kTake) << i;
}

TEST(ClientRatesTest, AReplayInLockstepDoesNotGoByTheClock) {
  ClientRates rates({});
  for (int i = 0; i < 10'000; ++i) ASSERT_EQ(rates.judge(Kind::kQuery, kStart, true), Judgement::kTake);
  EXPECT_EQ(rates.judge(Kind::kQuery, kStart), Judgement::kTake) << "nor does it use up what others have";
}

}  // namespace
}  // namespace cairn
