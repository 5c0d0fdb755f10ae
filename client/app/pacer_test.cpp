// SPDX-License-Identifier: Apache-2.0
#include "client/app/pacer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using testing::at_ms;
using testing::ListSource;
using testing::make_frame;
using testing::ManualClock;
using testing::regular_frames;

bool never() {
  return false;
}

struct Outcome {
  std::vector<int64_t> taken_ms;
  std::vector<int64_t> dropped_ms;
  std::vector<nanoseconds> late;  ///< of each taken frame, at the moment it was given out
  size_t undecodable = 0;
};

/// Runs a source to its end; work on the n-th taken frame costs cost(n).
template <typename Cost>
Outcome run(FrameSource& source, Pace pace, ManualClock& clock, Cost cost) {
  Pacer pacer(source, pace, clock, never);
  Outcome outcome;
  while (true) {
    const auto event = pacer.next();
    if (std::holds_alternative<EndOfFrames>(event)) return outcome;
    if (const auto* taken = std::get_if<TakenFrame>(&event)) {
      outcome.taken_ms.push_back(taken->frame.time.nanoseconds / 1'000'000);
      outcome.late.push_back(clock.now() - taken->due);
      clock.pass(cost(outcome.taken_ms.size() - 1));
    } else if (const auto* dropped = std::get_if<DroppedFrame>(&event)) {
      outcome.dropped_ms.push_back(dropped->time.nanoseconds / 1'000'000);
    } else {
      ++outcome.undecodable;
    }
  }
}

TEST(Pacer, FastTrackerGetsEveryFrameExactlyWhenItIsDue) {
  ManualClock clock;
  const auto start = clock.now();
  ListSource source(regular_frames(100, 33));
  const auto outcome = run(source, Pace::kRealtime, clock, [](size_t) { return milliseconds(10); });
  EXPECT_EQ(outcome.taken_ms.size(), 100U);
  EXPECT_TRUE(outcome.dropped_ms.empty());
  EXPECT_TRUE(std::all_of(outcome.late.begin(), outcome.late.end(),
                          [](auto late) { return late == nanoseconds(0); }));
  EXPECT_EQ(clock.now() - start, milliseconds(99 * 33 + 10));
}

TEST(Pacer, AFrameIsDroppedOnlyWhenItsSuccessorIsDue) {
  ManualClock clock;
  ListSource source(regular_frames(6, 30));
  // The first frame takes until 65 ms: 30 is superseded by 60, which is late by 5 ms but the newest there is.
  const auto outcome =
      run(source, Pace::kRealtime, clock, [](size_t n) { return milliseconds(n == 0 ? 65 : 1); });
  EXPECT_EQ(outcome.taken_ms, (std::vector<int64_t>{0, 60, 90, 120, 150}));
  EXPECT_EQ(outcome.dropped_ms, (std::vector<int64_t>{30}));
  EXPECT_EQ(outcome.late[1], milliseconds(5));
}

/// Laws for any load: nothing is lost or doubled, order is kept, and a frame given out is less than a period
/// old.
TEST(Pacer, EveryFrameIsTakenOrDroppedOnceAndTheTakenOnesAreTheNewest) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    ManualClock clock;
    constexpr size_t kFrames = 200;
    constexpr int kPeriod = 33;
    ListSource source(regular_frames(kFrames, kPeriod));
    const auto outcome =
        run(source, Pace::kRealtime, clock, [&random](size_t) { return milliseconds(random() % 90); });
    std::vector<int64_t> all;
    std::merge(outcome.taken_ms.begin(), outcome.taken_ms.end(), outcome.dropped_ms.begin(),
               outcome.dropped_ms.end(), std::back_inserter(all));
    ASSERT_EQ(all.size(), kFrames);
    for (size_t i = 0; i < kFrames; ++i) ASSERT_EQ(all[i], static_cast<int64_t>(i) * kPeriod);
    EXPECT_FALSE(outcome.dropped_ms.empty());
    for (size_t i = 0; i + 1 < outcome.late.size(); ++i)
      EXPECT_LT(outcome.late[i], milliseconds(kPeriod)) << i;
  }
}

TEST(Pacer, MaxAndLockstepNeverWaitAndNeverDrop) {
  for (const Pace pace : {Pace::kMax, Pace::kLockstep}) {
    ManualClock clock;
    const auto start = clock.now();
    ListSource source(regular_frames(50, 33));
    const auto outcome = run(source, pace, clock, [](size_t) { return milliseconds(100); });
    EXPECT_EQ(outcome.taken_ms.size(), 50U);
    EXPECT_TRUE(outcome.dropped_ms.empty());
    EXPECT_EQ(clock.now() - start, milliseconds(50 * 100));
  }
}

TEST(Pacer, AnUndecodableFrameIsReportedInItsPlaceAndTheRestGoOn) {
  ManualClock clock;
  auto items = regular_frames(5, 30);
  items[2] = fail(ErrorCode::kDamaged, "rgb/2.png: cut");
  ListSource source(std::move(items));
  // Late enough that the broken frame is met while looking ahead.
  const auto outcome = run(source, Pace::kRealtime, clock, [](size_t) { return milliseconds(35); });
  EXPECT_EQ(outcome.undecodable, 1U);
  EXPECT_EQ(outcome.taken_ms, (std::vector<int64_t>{0, 30, 90, 120}));
}

TEST(Pacer, AJumpOfTheStampsIsACutAndNotAPause) {
  for (const int64_t jump : {3'600'000LL, -3'600'000LL}) {
    ManualClock clock;
    const auto start = clock.now();
    std::deque<ListSource::Item> items;
    for (int64_t i = 0; i < 10; ++i) items.emplace_back(make_frame(i, at_ms(i * 30 + (i < 5 ? 0 : jump))));
    ListSource source(std::move(items));
    const auto outcome = run(source, Pace::kRealtime, clock, [](size_t) { return milliseconds(1); });
    EXPECT_EQ(outcome.taken_ms.size(), 10U) << jump;
    EXPECT_EQ(clock.now() - start, milliseconds(9 * 30 + 1)) << jump;
  }
}

TEST(Pacer, FramesThatACameraLostAreReportedWithStampsInBetween) {
  ManualClock clock;
  std::deque<ListSource::Item> items;
  items.emplace_back(make_frame(7, at_ms(100)));
  items.emplace_back(make_frame(10, at_ms(190)));
  items.emplace_back(make_frame(11, at_ms(220)));
  ListSource source(std::move(items), /*live=*/true);
  const auto outcome = run(source, Pace::kRealtime, clock, [](size_t) { return milliseconds(1); });
  EXPECT_EQ(outcome.taken_ms, (std::vector<int64_t>{100, 190, 220}));
  EXPECT_EQ(outcome.dropped_ms, (std::vector<int64_t>{130, 160}));
}

TEST(Pacer, ARequestToStopEndsTheWaitForAFrame) {
  ManualClock clock;
  const auto start = clock.now();
  std::deque<ListSource::Item> items;
  items.emplace_back(make_frame(0, at_ms(0)));
  items.emplace_back(make_frame(1, at_ms(4000)));
  ListSource source(std::move(items));
  Pacer pacer(source, Pace::kRealtime, clock, [&] { return clock.now() - start >= milliseconds(1000); });
  EXPECT_TRUE(std::holds_alternative<TakenFrame>(pacer.next()));
  EXPECT_TRUE(std::holds_alternative<EndOfFrames>(pacer.next()));
  EXPECT_LE(clock.now() - start, milliseconds(1100));
}

}  // namespace
}  // namespace cairn
