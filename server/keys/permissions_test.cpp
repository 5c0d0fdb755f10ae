// SPDX-License-Identifier: Apache-2.0
#include "server/keys/permissions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>
#include <string>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr Validity kValid{{1'800'000'000'000'000'000}, {1'800'003'600'000'000'000}};

Identity identity(IdentityRole role, const std::string& name) {
  Identity made;
  made.role = role;
  made.name = name;
  return made;
}

/// The partitions of the rules `kind` that name this topic.
std::set<std::string> partitions_of(const std::string& xml, const std::string& kind,
                                    const std::string& topic) {
  std::set<std::string> found;
  const std::regex rule("<" + kind + ">.*</" + kind + ">");
  const std::regex partition("<partition>([^<]*)</partition>");
  for (std::sregex_iterator it(xml.begin(), xml.end(), rule), end; it != end; ++it) {
    const std::string text = it->str();
    if (text.find("<topic>" + topic + "</topic>") == std::string::npos) continue;
    for (std::sregex_iterator p(text.begin(), text.end(), partition), last; p != last; ++p)
      found.insert((*p)[1]);
  }
  return found;
}

TEST(PermissionsTest, AClientWritesAndReadsInItsOwnPartitionsOnly) {
  const std::string xml =
      make_permissions(identity(IdentityRole::kClient, "phone-1"), "CN=phone-1,OU=client,O=cairn", kValid);
  EXPECT_THAT(partitions_of(xml, "publish", "KeyframeOffer"), ElementsAre("client.phone-1"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "MapInfo"), ElementsAre("client.phone-1"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "MapCommit"), ElementsAre("client.phone-1.map.*"));
  for (const char* topic : {"MapCommit", "MapInfo", "AdminRequest", "RigCommand", "WearerCamera"})
    EXPECT_TRUE(partitions_of(xml, "publish", topic).empty()) << topic;
  EXPECT_TRUE(partitions_of(xml, "subscribe", "KeyframeOffer").empty());
  EXPECT_THAT(xml, HasSubstr("<default>DENY</default>"));
  EXPECT_THAT(xml, HasSubstr("<subject_name>CN=phone-1,OU=client,O=cairn</subject_name>"));
  EXPECT_THAT(xml, HasSubstr("<not_after>2027-01-15T09:00:00</not_after>"));
}

TEST(PermissionsTest, ACarriedCameraAlsoSpeaksToItsRigAndItsWearersOtherCameras) {
  Identity client = identity(IdentityRole::kClient, "phone-1");
  client.rig = "shoulder";
  client.wearer = "ann";
  const std::string xml = make_permissions(client, "", kValid);
  EXPECT_THAT(partitions_of(xml, "publish", "RigCommand"), ElementsAre("rig.shoulder.client.phone-1"));
  EXPECT_THAT(partitions_of(xml, "publish", "TrackerState"),
              ElementsAre("client.phone-1", "rig.shoulder.client.phone-1"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "RigState"), ElementsAre("rig.shoulder"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "CameraPicture"), ElementsAre("wearer.ann"));
}

TEST(PermissionsTest, AnOperatorWhoWatchesCommandsNoRig) {
  Identity who = identity(IdentityRole::kOperator, "ann");
  EXPECT_THAT(partitions_of(make_permissions(who, "", kValid), "publish", "AdminRequest"),
              ElementsAre("operator.ann"));
  EXPECT_TRUE(partitions_of(make_permissions(who, "", kValid), "publish", "RigCommand").empty());
  who.duty = Duty::kCurate;
  EXPECT_THAT(partitions_of(make_permissions(who, "", kValid), "publish", "RigCommand"),
              ElementsAre("rig.*.operator.ann"));
}

TEST(PermissionsTest, TheServerWritesToClientsAndNotAsOne) {
  const std::string xml = make_permissions(identity(IdentityRole::kServer, "server"), "", kValid);
  EXPECT_THAT(partitions_of(xml, "publish", "MapCommit"), ElementsAre("client.*"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "KeyframeOffer"), ElementsAre("client.*"));
  EXPECT_THAT(partitions_of(xml, "subscribe", "AdminRequest"), ElementsAre("operator.*"));
  EXPECT_TRUE(partitions_of(xml, "publish", "KeyframeOffer").empty());
  EXPECT_TRUE(partitions_of(xml, "publish", "RigCommand").empty());
}

}  // namespace
}  // namespace cairn
