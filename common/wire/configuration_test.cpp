// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/configuration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace cairn::wire::internal {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ParticipantOptions client_of(uint32_t domain) {
  ParticipantOptions options;
  options.domain = domain;
  options.server_host = "127.0.0.1";
  return options;
}

TEST(Configuration, ClientsHaveTheServerAsOnlyPeer) {
  const std::string xml = make_configuration(client_of(7)).value();
  EXPECT_THAT(xml, HasSubstr("<Peer address=\"127.0.0.1:9160\" />"));
  EXPECT_THAT(xml, HasSubstr("<ParticipantIndex>none</ParticipantIndex>"));
  EXPECT_THAT(xml, HasSubstr("<AllowMulticast>false</AllowMulticast>"));
}

TEST(Configuration, TheServerHasAPlaceAndNoPeers) {
  ParticipantOptions options = client_of(7);
  options.role = Role::kServer;
  const std::string xml = make_configuration(options).value();
  EXPECT_THAT(xml, Not(HasSubstr("<Peer")));
  EXPECT_THAT(xml, HasSubstr("<ParticipantIndex>0</ParticipantIndex>"));
}

TEST(Configuration, HostNamesAreResolvedOrRefused) {
  ParticipantOptions options = client_of(0);
  options.server_host = "localhost";
  EXPECT_THAT(make_configuration(options).value(), HasSubstr("\"127.0.0.1:7410\""));
  options.server_host = "no-such-host.invalid";
  const auto refused = make_configuration(options);
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().code, ErrorCode::kNoServer);
  EXPECT_THAT(refused.error().message, HasSubstr("no-such-host.invalid"));
}

TEST(Configuration, ListenReplacesTheInterfaceOfTheProfile) {
  ParticipantOptions options = client_of(0);
  options.profile = "wifi";
  EXPECT_THAT(make_configuration(options).value(), HasSubstr("autodetermine"));
  options.listen = "lo";
  const std::string by_name = make_configuration(options).value();
  EXPECT_THAT(by_name, HasSubstr("name=\"lo\""));
  EXPECT_THAT(by_name, Not(HasSubstr("autodetermine")));
  options.listen = "127.0.0.1";
  EXPECT_THAT(make_configuration(options).value(), HasSubstr("address=\"127.0.0.1\""));
  options.listen = "no-such-if";
  const auto refused = make_configuration(options);
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(refused.error().message, HasSubstr("no-such-if"));
}

TEST(Configuration, TextsOfTheUserStayText) {
  ParticipantOptions options = client_of(0);
  options.tag = "<a&\"b\">";
  EXPECT_THAT(make_configuration(options).value(), HasSubstr("<Tag>&lt;a&amp;&quot;b&quot;&gt;</Tag>"));
}

TEST(Configuration, AProfileOfWindowsLosesItsMark) {
  const std::string path = ::testing::TempDir() + "cairn-profile-" + std::to_string(getpid()) + ".xml";
  ParticipantOptions options = client_of(0);
  options.profile = path;
  std::ofstream(path) << "\xef\xbb\xbf<CycloneDDS></CycloneDDS>";
  const auto marked = make_configuration(options);
  std::ofstream(path) << std::string("\xff\xfe<\0", 4);
  const auto wide = make_configuration(options);
  ::unlink(path.c_str());
  ASSERT_TRUE(marked) << marked.error().message;
  EXPECT_TRUE(marked->starts_with("<CycloneDDS>"));
  ASSERT_FALSE(wide);
  EXPECT_THAT(wide.error().message, HasSubstr("is UTF-16 text"));
}

TEST(Configuration, NamesWhatIsWrong) {
  ParticipantOptions options = client_of(kMaxDomain + 1);
  EXPECT_EQ(make_configuration(options).error().code, ErrorCode::kConfiguration);
  options = client_of(0);
  options.profile = "/no/such/profile.xml";
  EXPECT_THAT(make_configuration(options).error().message, HasSubstr("/no/such/profile.xml"));
}

}  // namespace
}  // namespace cairn::wire::internal
