// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/rejected_hypotheses.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int64_t kSecond = 1'000'000'000;

PoseHypothesis place(uint64_t keyframe) {
  PoseHypothesis hypothesis;
  hypothesis.epoch = Epoch{1};
  hypothesis.reference = KeyframeId{keyframe};
  return hypothesis;
}

/// Rejects a place ten times a second until it is; how often that took.
int reject_until(RejectedHypotheses* places, const PoseHypothesis& hypothesis, int64_t begin) {
  for (int i = 1; i <= 100; ++i) {
    const Timestamp now{begin + i * kSecond / 10};
    places->reject(hypothesis, now);
    if (places->is_rejected(hypothesis, now)) return i;
  }
  return 0;
}

TEST(RejectedHypotheses, OnlyWhatFailsAgainAndAgainIsRejectedAndOnlyThere) {
  RejectedHypotheses places{RejectedHypothesesOptions()};
  EXPECT_FALSE(places.is_rejected(place(1), {0}));
  EXPECT_GT(reject_until(&places, place(1), 0), 1);
  EXPECT_FALSE(places.is_rejected(place(2), {kSecond}));
  PoseHypothesis later = place(1);
  later.epoch = Epoch{2};
  EXPECT_FALSE(places.is_rejected(later, {kSecond}));
}

TEST(RejectedHypotheses, ItIsForgottenInTimeAndWhenSomethingIsVerified) {
  RejectedHypotheses places{RejectedHypothesesOptions()};
  const int times = reject_until(&places, place(1), 0);
  EXPECT_TRUE(places.is_rejected(place(1), {2 * kSecond}));
  EXPECT_FALSE(places.is_rejected(place(1), {60 * kSecond}));
  EXPECT_EQ(reject_until(&places, place(1), 60 * kSecond), times) << "counted anew";
  places.forget();
  EXPECT_FALSE(places.is_rejected(place(1), {61 * kSecond}));
}

}  // namespace
}  // namespace cairn
