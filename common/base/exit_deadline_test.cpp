// SPDX-License-Identifier: Apache-2.0
#include "common/base/exit_deadline.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <string>
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

TEST(ExitDeadlineDeathTest, WhatIsToGoOnBeginsAgainUnderItsIdWithoutWhatItHeld) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        const std::string held = std::to_string(dup(STDERR_FILENO));
        const std::string look = "test $$ = $0 && ! test -e /proc/self/fd/" + held + " && exit 7";
        const ExitDeadline deadline(Command{"/bin/sh", {"sh", "-c", look, std::to_string(getpid())}}, 20ms,
                                    make_logger("a-program"));
        while (true) std::this_thread::sleep_for(1h);
      },
      ::testing::ExitedWithCode(7), "does not close within 20 ms: beginning again");
}

TEST(ExitDeadlineDeathTest, WhatCannotBeginAgainEnds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        const ExitDeadline deadline(Command{"/no/such/program", {"program"}}, 20ms, make_logger("a-program"));
        while (true) std::this_thread::sleep_for(1h);
      },
      ::testing::ExitedWithCode(1), "beginning again");
}

TEST(OwnCommand, IsThisProgramAndItsArguments) {
  const Command command = own_command();
  EXPECT_EQ(command.program, "/proc/self/exe");
  ASSERT_FALSE(command.arguments.empty());
  EXPECT_NE(command.arguments[0].find("test"), std::string::npos);
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
