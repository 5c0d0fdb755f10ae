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
  return options;
}

const NetworkPath kOnThisHost{"127.0.0.1", "lo", "127.0.0.1"};
const NetworkPath kOverTheAir{"10.77.0.1", "wlan0", "10.77.0.2"};

TEST(Configuration, ClientsHaveTheServerAsOnlyPeer) {
  const std::string xml = make_configuration(client_of(7), kOnThisHost).value();
  EXPECT_THAT(xml, HasSubstr("<Peer address=\"127.0.0.1:9160\" />"));
  EXPECT_THAT(xml, HasSubstr("<ParticipantIndex>none</ParticipantIndex>"));
  EXPECT_THAT(xml, HasSubstr("<AllowMulticast>false</AllowMulticast>"));
}

TEST(Configuration, TheServerHasAPlaceAndNoPeers) {
  ParticipantOptions options = client_of(7);
  options.role = Role::kServer;
  const std::string xml = make_configuration(options, kOnThisHost).value();
  EXPECT_THAT(xml, Not(HasSubstr("<Peer")));
  EXPECT_THAT(xml, HasSubstr("<ParticipantIndex>0</ParticipantIndex>"));
}

TEST(Configuration, ARigHasAPlaceAndTheServerAsPeerAndItsClientsHaveTheRig) {
  ParticipantOptions options = client_of(7);
  options.role = Role::kRig;
  const std::string rig = make_configuration(options, kOnThisHost).value();
  EXPECT_THAT(rig, HasSubstr("<Peer address=\"127.0.0.1:9160\" />"));
  EXPECT_THAT(rig, HasSubstr("<ParticipantIndex>50</ParticipantIndex>"));
  options.role = Role::kRigClient;
  const std::string client = make_configuration(options, kOnThisHost).value();
  EXPECT_THAT(client, HasSubstr("<Peer address=\"127.0.0.1:9260\" />"));
  EXPECT_THAT(client, HasSubstr("<ParticipantIndex>none</ParticipantIndex>"));
}

TEST(Configuration, NoProfileHasPeersSayHowMuchIsPutTogether) {
  for (const char* profile : {"loopback", "wifi"}) {
    ParticipantOptions options = client_of(0);
    options.profile = profile;
    EXPECT_THAT(make_configuration(options, kOnThisHost).value(),
                HasSubstr("<MaxSampleSize>" + std::to_string(kMaxSampleBytes) + "B</MaxSampleSize>"));
  }
}

TEST(Configuration, TheCamerasOfAWearerArePeersOfEachOtherAndOfNobodyElse) {
  ParticipantOptions options = client_of(7);
  options.role = Role::kWearerCamera;
  const std::string xml = make_configuration(options, kOnThisHost, 2).value();
  EXPECT_THAT(xml, HasSubstr("<ParticipantIndex>62</ParticipantIndex>"));
  for (const char* port : {"9280", "9284", "9294"})
    EXPECT_THAT(xml, HasSubstr("<Peer address=\"127.0.0.1:" + std::string(port) + "\" />"));
  EXPECT_THAT(xml, Not(HasSubstr(":9160\"")));
  EXPECT_THAT(xml, Not(HasSubstr(":9260\"")));
  EXPECT_LT(wearer_port(7, kMaxWearerCameras - 1) + 1, server_port(8) - 10) << "of the next domain";
}

/// Only what is woken by no packet, and waits for none, ends when the address is gone.
TEST(Configuration, ClosingNeedsNoAddressOfOurs) {
  const std::string xml = make_configuration(client_of(0), kOnThisHost).value();
  EXPECT_THAT(xml, HasSubstr("<MultipleReceiveThreads>false</MultipleReceiveThreads>"));
  EXPECT_THAT(xml, HasSubstr("<WriterLingerDuration>0s</WriterLingerDuration>"));
}

TEST(Configuration, TheInterfaceOfThePathTakesTheChoiceFromTheMiddleware) {
  ParticipantOptions options = client_of(0);
  options.profile = "wifi";
  const std::string xml = make_configuration(options, kOverTheAir).value();
  EXPECT_THAT(xml, HasSubstr("NetworkInterface address=\"10.77.0.2\""));
  EXPECT_THAT(xml, Not(HasSubstr("autodetermine")));
  EXPECT_THAT(xml, HasSubstr("<Peer address=\"10.77.0.1:7410\" />"));
  EXPECT_THAT(xml, Not(HasSubstr("127.0.0.1")));
  EXPECT_THAT(make_configuration(options, {}).value(), HasSubstr("autodetermine"))
      << "without a network it is the middleware's";
}

TEST(Configuration, AServerOnANetworkServesItsOwnHostToo) {
  ParticipantOptions options = client_of(0);
  options.role = Role::kServer;
  options.profile = "wifi";
  const std::string xml = make_configuration(options, {"", "wlan0", "10.77.0.1"}).value();
  EXPECT_THAT(xml, HasSubstr("NetworkInterface address=\"10.77.0.1\""));
  EXPECT_THAT(xml, HasSubstr("NetworkInterface address=\"127.0.0.1\""));
  EXPECT_THAT(make_configuration(options, {}).value(), Not(HasSubstr("127.0.0.1")))
      << "the middleware takes it by itself, and refuses it twice";
}

TEST(Configuration, AnInterfaceThatAProfileNamesStaysUnlessAnotherIsAskedFor) {
  ParticipantOptions options = client_of(0);
  const std::string stays = make_configuration(options, kOverTheAir).value();
  EXPECT_THAT(stays, HasSubstr("NetworkInterface address=\"127.0.0.1\""));
  EXPECT_THAT(stays, Not(HasSubstr("10.77.0.2")));
  options.listen = "wlan0";
  const std::string asked = make_configuration(options, kOverTheAir).value();
  EXPECT_THAT(asked, HasSubstr("NetworkInterface address=\"10.77.0.2\""));
  EXPECT_THAT(asked, Not(HasSubstr("127.0.0.1")));
}

TEST(Configuration, WhatInterfaceAProfileNames) {
  EXPECT_EQ(interface_of_profile("<NetworkInterface name=\"eth0\" multicast=\"false\" />"), "eth0");
  EXPECT_EQ(interface_of_profile("<NetworkInterface multicast=\"false\" address=\"10.0.0.1\"/>"), "10.0.0.1");
  EXPECT_EQ(interface_of_profile("<NetworkInterfaceAddress>eth1</NetworkInterfaceAddress>"), "eth1");
  EXPECT_EQ(interface_of_profile("<NetworkInterface autodetermine=\"true\" />"), std::nullopt);
  EXPECT_EQ(interface_of_profile("<General></General>"), std::nullopt);
  for (const char* cut :
       {"<NetworkInterface name=\"", "<NetworkInterfaceAddress", "<NetworkInterfaceAddress>"})
    EXPECT_EQ(interface_of_profile(cut).value_or(""), "") << "cut off";
}

TEST(Configuration, TextsOfTheUserStayText) {
  ParticipantOptions options = client_of(0);
  options.tag = "<a&\"b\">";
  EXPECT_THAT(make_configuration(options, kOnThisHost).value(),
              HasSubstr("<Tag>&lt;a&amp;&quot;b&quot;&gt;</Tag>"));
}

TEST(Configuration, AProfileOfWindowsLosesItsMark) {
  const std::string path = ::testing::TempDir() + "cairn-profile-" + std::to_string(getpid()) + ".xml";
  ParticipantOptions options = client_of(0);
  options.profile = path;
  std::ofstream(path) << "\xef\xbb\xbf<CycloneDDS></CycloneDDS>";
  const auto marked = make_configuration(options, kOnThisHost);
  std::ofstream(path) << std::string("\xff\xfe<\0", 4);
  const auto wide = make_configuration(options, kOnThisHost);
  ::unlink(path.c_str());
  ASSERT_TRUE(marked) << marked.error().message;
  EXPECT_TRUE(marked->starts_with("<CycloneDDS>"));
  ASSERT_FALSE(wide);
  EXPECT_THAT(wide.error().message, HasSubstr("is UTF-16 text"));
}

TEST(Configuration, NamesWhatIsWrong) {
  ParticipantOptions options = client_of(kMaxDomain + 1);
  EXPECT_EQ(make_configuration(options, kOnThisHost).error().code, ErrorCode::kConfiguration);
  options = client_of(0);
  options.profile = "/no/such/profile.xml";
  EXPECT_THAT(make_configuration(options, kOnThisHost).error().message, HasSubstr("/no/such/profile.xml"));
}

}  // namespace
}  // namespace cairn::wire::internal
