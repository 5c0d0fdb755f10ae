// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/refuted_places.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int64_t kSecond = 1'000'000'000;

PoseSuggestion place(uint64_t keyframe) {
  PoseSuggestion suggestion;
  suggestion.epoch = Epoch{1};
  suggestion.reference = KeyframeId{keyframe};
  return suggestion;
}

/// Refutes a place ten times a second until it is; how often that took.
int refute_until(RefutedPlaces* places, const PoseSuggestion& suggestion, int64_t begin) {
  for (int i = 1; i <= 100; ++i) {
    const Timestamp now{begin + i * kSecond / 10};
    places->refute(suggestion, now);
    if (places->is_refuted(suggestion, now)) return i;
  }
  return 0;
}

TEST(RefutedPlaces, OnlyWhatFailsAgainAndAgainIsRefutedAndOnlyThere) {
  RefutedPlaces places;
  EXPECT_FALSE(places.is_refuted(place(1), {0}));
  EXPECT_GT(refute_until(&places, place(1), 0), 1);
  EXPECT_FALSE(places.is_refuted(place(2), {kSecond}));
  PoseSuggestion later = place(1);
  later.epoch = Epoch{2};
  EXPECT_FALSE(places.is_refuted(later, {kSecond}));
}

TEST(RefutedPlaces, ItIsForgottenInTimeAndWhenSomethingIsProven) {
  RefutedPlaces places;
  const int times = refute_until(&places, place(1), 0);
  EXPECT_TRUE(places.is_refuted(place(1), {2 * kSecond}));
  EXPECT_FALSE(places.is_refuted(place(1), {60 * kSecond}));
  EXPECT_EQ(refute_until(&places, place(1), 60 * kSecond), times) << "counted anew";
  places.forget();
  EXPECT_FALSE(places.is_refuted(place(1), {61 * kSecond}));
}

}  // namespace
}  // namespace cairn
