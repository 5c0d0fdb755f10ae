// SPDX-License-Identifier: Apache-2.0
// What the middleware logs, as the program does.
#include <dds/ddsrt/log.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <memory>
#include <sstream>
#include <string>

#include "common/wire/log_redirect.h"

namespace cairn::wire {
namespace {

using ::testing::HasSubstr;

TEST(LogRedirect, PassesOnAFewLinesAndCountsTheRest) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  {
    const LogRedirect redirect(logger, 3);
    for (int i = 0; i < 100; ++i) dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "line %d\n", i);
  }
  const std::string said = text.str();
  EXPECT_THAT(said, HasSubstr("dds: line 0"));
  EXPECT_LE(std::count(said.begin(), said.end(), '\n'), 9)
      << "3 a second, unless the machine stood still for two";
  EXPECT_GE(std::count(said.begin(), said.end(), '\n'), 3);
}

TEST(LogRedirect, SaysTheSameThingOnce) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  {
    const LogRedirect redirect(logger, 1000);
    for (int i = 0; i < 50; ++i) dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "is away\n");
    dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "something else\n");
  }
  const std::string said = text.str();
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 2)
      << said << "unless the machine stood still for 10 s";
  EXPECT_THAT(said, HasSubstr("something else (49 lines passed over)"));
}

}  // namespace
}  // namespace cairn::wire
