// SPDX-License-Identifier: Apache-2.0
// What the middleware logs, as the program does.
#include <dds/ddsrt/log.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include "common/wire/log_redirect.h"

namespace cairn::wire {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// What the program logs at `level` of one line of the middleware's.
std::string logged(const char* line, spdlog::level::level_enum level,
                   std::shared_ptr<RefusedPeers> refused = nullptr) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  logger->set_level(level);
  const LogRedirect redirect(logger, 10, std::move(refused));
  dds_log(DDS_LC_ERROR, "a.c", 7, "send", "%s\n", line);
  return text.str();
}

TEST(LogRedirect, SaysInPlainWordsWhatIsKnownAndNothingOfWhatIsHarmless) {
  const std::string unsent =
      logged("ddsi_udp_conn_write to udp/10.0.0.1:7410 failed with retcode -58", spdlog::level::warn);
  EXPECT_THAT(unsent, HasSubstr("a message to udp/10.0.0.1:7410 could not be sent: it is larger than"));
  EXPECT_THAT(unsent, Not(HasSubstr("retcode")));
  EXPECT_THAT(logged("ddsi_udp_conn_write to udp/10.0.0.1:7410 failed with retcode -1", spdlog::level::warn),
              HasSubstr("(code -1)"));
  const char* harmless = "dds_participant_delete: internal error -3";
  EXPECT_EQ(logged(harmless, spdlog::level::warn), "");
  EXPECT_THAT(logged(harmless, spdlog::level::debug), HasSubstr(harmless)) << "for who looks for a fault";
}

TEST(LogRedirect, WhoWasNotLetInIsToldByWhoeverOwnsTheList) {
  const char* line =
      "Process handshake failed: Certificate not valid: error: certificate revoked; subject: "
      "/O=cairn/OU=client/CN=phone-1(code: 200)";
  const auto refused = std::make_shared<RefusedPeers>();
  EXPECT_EQ(logged(line, spdlog::level::warn, refused), "");
  EXPECT_EQ(refused->take().size(), 1U);
  EXPECT_THAT(logged(line, spdlog::level::warn), HasSubstr("certificate revoked")) << "where nobody does";
}

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
