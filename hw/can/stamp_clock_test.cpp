// SPDX-License-Identifier: Apache-2.0
#include "hw/can/stamp_clock.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr int64_t kMs = 1'000'000;
constexpr int64_t kSecond = 1000 * kMs;
constexpr int64_t kEpoch = 1'700'000'000 * kSecond;

TEST(StampClock, IsTheWallClockWhileNobodySetsIt) {
  StampClock clock({kEpoch, 5 * kSecond});
  EXPECT_EQ(clock.stamp(kEpoch + 10 * kMs, {kEpoch + 12 * kMs, 5 * kSecond + 12 * kMs}).nanoseconds,
            kEpoch + 10 * kMs);
  const auto real = StampClock::read();
  EXPECT_EQ(StampClock(real).stamp(real.wall, real).nanoseconds, real.wall);
}

TEST(StampClock, AClockThatIsSetLeavesTheStepsBetweenFramesAsTheyAre) {
  for (const int64_t jump : {3600 * kSecond, -3600 * kSecond, 40 * kMs, -40 * kMs}) {
    StampClock clock({kEpoch, 0});
    int64_t previous = 0;
    for (int i = 1; i <= 100; ++i) {
      const int64_t elapsed = i * 10 * kMs;
      const int64_t wall = kEpoch + elapsed + (i > 50 ? jump : 0);
      const int64_t stamp = clock.stamp(wall - kMs, {wall, elapsed}).nanoseconds;
      if (i > 1) {
        EXPECT_EQ(stamp - previous, 10 * kMs) << jump;
      }
      previous = stamp;
    }
  }
}

TEST(StampClock, AFrameThatWasQueuedWhileTheClockWasSetStaysBetweenItsNeighbours) {
  for (const int64_t jump : {3600 * kSecond, -3600 * kSecond}) {
    StampClock clock({kEpoch, 0});
    const Timestamp before = clock.stamp(kEpoch + 10 * kMs, {kEpoch + 11 * kMs, 11 * kMs});
    const Timestamp amid = clock.stamp(kEpoch + 20 * kMs, {kEpoch + 25 * kMs + jump, 25 * kMs});
    EXPECT_GE(amid, before);
    EXPECT_LE(amid.nanoseconds, kEpoch + 25 * kMs);
    const Timestamp after = clock.stamp(kEpoch + 30 * kMs + jump, {kEpoch + 31 * kMs + jump, 31 * kMs});
    EXPECT_GE(after, amid);
    EXPECT_EQ(after.nanoseconds, kEpoch + 30 * kMs);
  }
}

}  // namespace
}  // namespace cairn
