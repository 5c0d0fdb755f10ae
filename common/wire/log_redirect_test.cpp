// SPDX-License-Identifier: Apache-2.0
// What the middleware logs, as the program does.
#include <dds/ddsrt/log.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <memory>
#include <sstream>
#include <string>

#include "common/wire/log_redirect.h"

namespace cairn::wire {
namespace {

using ::testing::HasSubstr;

TEST(LogRedirect, FoldsWhatTheMiddlewareRepeats) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  {
    const LogRedirect redirect(logger);
    for (int i = 0; i < 50; ++i) dds_log(DDS_LC_ERROR, "a.c", 7, "send", "is away\n");
    dds_log(DDS_LC_WARNING, "b.c", 7, "receive", "something else\n");
  }
  EXPECT_THAT(text.str(), HasSubstr("dds: is away\n"));
  EXPECT_THAT(text.str(), HasSubstr("dds: something else\n"));
  EXPECT_THAT(text.str(), HasSubstr("dds: … and 49 more like it, the last: is away\n"))
      << "at the end, unless the machine stood still for 10 s";
}

}  // namespace
}  // namespace cairn::wire
