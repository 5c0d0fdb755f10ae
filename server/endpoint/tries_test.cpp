// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/tries.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr MonotonicTime kBegin{std::chrono::hours(1)};

wire::PeerId process(uint8_t number) {
  wire::PeerId id;
  id.bytes[0] = number;
  return id;
}

TEST(Tries, TheFirstOfEachProcessAndAfterAPauseIsToldAtOnceAndTheRestCountedOnceAMinute) {
  Tries tries;
  const MonotonicTime end = kBegin + Tries::kInterval;
  EXPECT_EQ(tries.note("phone", process(1), kBegin), 0U);
  size_t untold = 0;
  for (MonotonicTime now = kBegin; now < end; now += milliseconds(200), ++untold)
    EXPECT_EQ(tries.note("phone", process(1), now), std::nullopt);
  EXPECT_EQ(tries.note("phone", process(1), end), untold);
  EXPECT_EQ(tries.note("phone", process(2), end), 0U) << "another process";
  EXPECT_EQ(tries.note("tablet", process(1), end), 0U) << "somebody else";
  EXPECT_EQ(tries.note("phone", process(2), end + Tries::kPause - milliseconds(1)), std::nullopt);
  EXPECT_EQ(tries.note("phone", process(2), end + 2 * Tries::kPause), 1U) << "after a pause";
  EXPECT_EQ(tries.note("phone", std::nullopt, end + 2 * Tries::kPause), std::nullopt)
      << "of a process that is not known: it may be the same";
}

TEST(Tries, AnyNumberOfProcessesIsToldAFewTimesAMinute) {
  Tries tries;
  size_t told = 0;
  for (int i = 0; i < 10'000; ++i)
    told += tries.note("phone", process(static_cast<uint8_t>(i)), kBegin + milliseconds(i)).has_value();
  EXPECT_LE(told, static_cast<size_t>(Tries::kMostAtOnce) + 2);
}

}  // namespace
}  // namespace cairn
