// SPDX-License-Identifier: Apache-2.0
#include "common/wire/partition.h"

#include <gtest/gtest.h>

namespace cairn::wire {
namespace {

const MapId kMap{{1, 2, 3}};

TEST(Partition, ParsesWhatItMakes) {
  for (const std::string name : {"a", "desk-1", "map", "client"}) {
    EXPECT_EQ(parse_partition(client_partition(name)), (PartitionIdentity{name, std::nullopt}));
    EXPECT_EQ(parse_partition(map_partition(name, kMap)), (PartitionIdentity{name, kMap}));
  }
  EXPECT_EQ(map_partition("a", kMap), "client.a.map.01020300000000000000000000000000");
}

TEST(Partition, AnythingElseIsNobody) {
  const std::string hex(32, '0');
  for (const std::string& text :
       {std::string("*"), std::string("client.*"), std::string("client.a*"), std::string("client."),
        std::string("client"), std::string("Client.a"), std::string("client.A"), std::string("client.a.b"),
        std::string("client.a.map."), std::string("client.a.map.xyz"), std::string("client.a.map.*"),
        std::string("client.a.map.").append(hex).append("0"),
        std::string("client.a.map.").append(hex).append(".map.").append(hex),
        std::string("client..map.").append(hex)}) {
    EXPECT_EQ(parse_partition(text), std::nullopt) << text;
  }
}

TEST(Partition, OperatorsHaveTheirOwn) {
  EXPECT_EQ(parse_operator_partition(operator_partition("ada")), "ada");
  for (const std::string& text : {client_partition("ada"), std::string("operator.*"),
                                  std::string("operator."), std::string("operator.a.b")}) {
    EXPECT_EQ(parse_operator_partition(text), std::nullopt) << text;
  }
  EXPECT_EQ(parse_partition(operator_partition("ada")), std::nullopt);
  EXPECT_EQ(parse_partition(rig_partition("ada")), std::nullopt);
  EXPECT_EQ(rig_partition("shoulder"), "rig.shoulder");
}

TEST(Partition, WhoSpeaksToARigIsKnownByHis) {
  EXPECT_EQ(parse_rig_speaker(client_to_rig_partition("shoulder", "eye")),
            (RigSpeaker{"shoulder", "eye", false}));
  EXPECT_EQ(parse_rig_speaker(operator_to_rig_partition("shoulder", "ann")),
            (RigSpeaker{"shoulder", "ann", true}));
  for (const std::string& text :
       {rig_partition("shoulder"), everybody_to_rig("shoulder"), client_to_rig_partition("*", "eye"),
        client_to_rig_partition("shoulder", "*"), client_to_rig_partition("shoulder", ""),
        client_to_rig_partition("", "eye"), client_to_rig_partition("a.b", "eye"),
        client_to_rig_partition("shoulder", "eye.operator.ann"), std::string("rig.shoulder.server.x"),
        "rig.shoulder." + map_partition("eye", MapId{{1}}), client_partition("eye")}) {
    EXPECT_EQ(parse_rig_speaker(text), std::nullopt) << text;
  }
}

}  // namespace
}  // namespace cairn::wire
