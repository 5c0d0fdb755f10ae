// SPDX-License-Identifier: Apache-2.0
#include "common/base/exit_deadline.h"

#include <gtest/gtest.h>

#include <thread>

namespace cairn {
namespace {

using namespace std::chrono_literals;

TEST(ExitDeadlineDeathTest, WhatNeverClosesDoesNotHoldTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        const ExitDeadline deadline(5, 20ms, make_logger("a-program"));
        while (true) std::this_thread::sleep_for(1h);
      },
      ::testing::ExitedWithCode(5), "does not close within 20 ms");
}

TEST(ExitDeadlineDeathTest, WhatClosesInTimeEndsAsEver) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        { const ExitDeadline deadline(5, 1h, make_logger("a-program")); }
        std::exit(0);
      },
      ::testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace cairn
