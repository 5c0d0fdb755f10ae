// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {
namespace {

TEST(Timestamp, SecondsRoundTripToANanosecond) {
  for (const double s : {0.0, 0.033333, 1305031102.175304, -1.5}) {
    EXPECT_NEAR(Timestamp::from_seconds(s).seconds(), s, std::abs(s) * 1e-15 + 1e-9);
  }
}

TEST(Timestamp, DifferenceUndoesSum) {
  const Timestamp t{1'700'000'000'000'000'001};
  const auto step = std::chrono::nanoseconds(33'333'333);
  EXPECT_EQ((t + step) - t, step);
}

TEST(Result, EveryErrorHasAnExitCodeOfTheContract) {
  EXPECT_EQ(exit_code(ErrorCode::kUsage), 2);
  EXPECT_EQ(exit_code(ErrorCode::kConfiguration), 3);
  EXPECT_EQ(exit_code(ErrorCode::kNoServer), 4);
  EXPECT_EQ(exit_code(ErrorCode::kRefused), 5);
  EXPECT_EQ(exit_code(ErrorCode::kDamaged), 6);
}

TEST(Log, VerbosityChoosesTheLevel) {
  EXPECT_FALSE(make_logger("t", -1)->should_log(spdlog::level::info));
  EXPECT_TRUE(make_logger("t", 0)->should_log(spdlog::level::info));
  EXPECT_TRUE(make_logger("t", 1)->should_log(spdlog::level::debug));
}

}  // namespace
}  // namespace cairn
