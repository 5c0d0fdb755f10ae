// SPDX-License-Identifier: Apache-2.0
#include "server/keys/permissions.h"

#include <string_view>
#include <vector>

#include "common/base/utc.h"
#include "common/wire/discovered.h"
#include "common/wire/partition.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "common/wire/wearer_messages.h"

namespace cairn {
namespace {

using Names = std::vector<std::string>;

/// The XML of one kind of rule, `publish` or `subscribe`: these topics, in these partitions.
std::string rule(const char* kind, const Names& topics, const Names& partitions) {
  std::string text = std::string("      <") + kind + "><topics>";
  for (const std::string& topic : topics) text += "<topic>" + topic + "</topic>";
  text += "</topics><partitions>";
  for (const std::string& partition : partitions) text += "<partition>" + partition + "</partition>";
  return text + "</partitions></" + kind + ">\n";
}

template <typename... Messages>
Names topics() {
  return {std::string(wire::topic_name<Messages>())...};
}

// The table of idl/README.md, by who writes and who reads.
Names said_by_clients() {
  return topics<wire::CameraMessage, wire::MapSeed, wire::KeyframeOffer, wire::TrackerStateMessage,
                wire::RelocQuery, wire::ClientRequest>();
}
Names said_to_clients() {
  return topics<wire::ServerStatus, wire::MapInfo, wire::SeedVerdict, wire::OfferVerdict, wire::RelocAnswer,
                wire::CameraEstimate, wire::ClientReply>();
}
Names parts_of_maps() {
  return topics<wire::PointPatches, wire::PointPositions, wire::KeyframePoses, wire::MapCommit,
                wire::LabelMessage>();
}
Names said_to_rigs() {
  return topics<wire::RigCommand, wire::TrackerStateMessage>();
}
Names said_among_cameras() {
  return topics<wire::WearerCamera, wire::PictureRequest, wire::CameraPicture>();
}

std::string rules_of_client(const Identity& client) {
  const std::string own = wire::client_partition(client.name);
  std::string rules = rule("publish", said_by_clients(), {own}) +
                      rule("subscribe", said_to_clients(), {own}) +
                      rule("subscribe", parts_of_maps(), {own + ".map.*"});
  if (!client.rig.empty()) {
    rules += rule("publish", said_to_rigs(), {wire::client_to_rig_partition(client.rig, client.name)}) +
             rule("subscribe", topics<wire::RigState>(), {wire::rig_partition(client.rig)});
  }
  if (!client.wearer.empty()) {
    const Names wearer{wire::wearer_partition(client.wearer)};
    rules += rule("publish", said_among_cameras(), wearer) + rule("subscribe", said_among_cameras(), wearer);
  }
  return rules;
}

std::string rules_of_server() {
  const Names clients{std::string(wire::kEveryClient)};
  const Names operators{std::string(wire::kEveryOperator)};
  return rule("publish", said_to_clients(), clients) + rule("publish", parts_of_maps(), clients) +
         rule("subscribe", said_by_clients(), clients) +
         rule("publish", topics<wire::AdminReply>(), operators) +
         rule("subscribe", topics<wire::AdminRequest>(), operators) +
         rule("subscribe", topics<wire::RigState>(), {std::string(wire::kEveryRig)});
}

/// Permissions of an operator. Its role decides at the server which of its requests are done; rigs have no
/// server between.
std::string rules_of_operator(const Identity& who) {
  const Names own{wire::operator_partition(who.name)};
  const Names rigs{std::string(wire::kEveryRig)};
  std::string rules = rule("publish", topics<wire::AdminRequest>(), own) +
                      rule("subscribe", topics<wire::AdminReply>(), own) +
                      rule("subscribe", topics<wire::RigState>(), rigs);
  if (who.duty != Duty::kWatch) {
    rules += rule("publish", topics<wire::RigCommand>(), {wire::operator_to_rig_partition("*", who.name)});
  }
  return rules;
}

std::string rules_of_rig(const Identity& rig) {
  return rule("publish", topics<wire::RigState>(), {wire::rig_partition(rig.name)}) +
         rule("subscribe", said_to_rigs(), {wire::everybody_to_rig(rig.name)});
}

std::string rules_of(const Identity& identity) {
  switch (identity.role) {
    case IdentityRole::kClient:
      return rules_of_client(identity);
    case IdentityRole::kServer:
      return rules_of_server();
    case IdentityRole::kOperator:
      return rules_of_operator(identity);
    case IdentityRole::kRig:
      return rules_of_rig(identity);
  }
  return {};
}

/// "2026-12-01T12:00:00": the middleware takes a time without a zone as UTC.
std::string to_xml(Timestamp time) {
  std::string text = to_utc(time);
  text.pop_back();
  return text;
}

/// Any. The middleware takes no number above 230 here.
constexpr std::string_view kAnyDomain = "<domains><id_range><min>0</min><max>230</max></id_range></domains>";

constexpr std::string_view kSchema =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" xsi:noNamespaceSchemaLocation=\"";

}  // namespace

// Submessages are encrypted and not samples alone: with samples alone Cyclone 0.10 gives a reader the keys of
// a writer twice when both are matched in two threads at once, and a process that gets them twice before it
// knows the writer crashes.
std::string make_governance() {
  return std::string(kSchema) +
         "omg_shared_ca_governance.xsd\">\n"
         "  <domain_access_rules><domain_rule>\n    " +
         std::string(kAnyDomain) +
         "\n"
         "    <allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
         "    <enable_join_access_control>true</enable_join_access_control>\n"
         "    <discovery_protection_kind>ENCRYPT</discovery_protection_kind>\n"
         "    <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>\n"
         "    <rtps_protection_kind>SIGN</rtps_protection_kind>\n"
         "    <topic_access_rules><topic_rule>\n"
         "      <topic_expression>*</topic_expression>\n"
         "      <enable_discovery_protection>true</enable_discovery_protection>\n"
         "      <enable_liveliness_protection>true</enable_liveliness_protection>\n"
         "      <enable_read_access_control>true</enable_read_access_control>\n"
         "      <enable_write_access_control>true</enable_write_access_control>\n"
         "      <metadata_protection_kind>ENCRYPT</metadata_protection_kind>\n"
         "      <data_protection_kind>NONE</data_protection_kind>\n"
         "    </topic_rule></topic_access_rules>\n"
         "  </domain_rule></domain_access_rules>\n</dds>\n";
}

std::string make_permissions(const Identity& identity, const std::string& subject, const Validity& validity) {
  return std::string(kSchema) + "omg_shared_ca_permissions.xsd\">\n  <permissions><grant name=\"" +
         std::string(to_string(identity.role)) + "-" + identity.name + "\">\n    <subject_name>" + subject +
         "</subject_name>\n    <validity><not_before>" + to_xml(validity.begins) +
         "</not_before><not_after>" + to_xml(validity.expires) +
         "</not_after></validity>\n    <allow_rule>\n      " + std::string(kAnyDomain) + "\n" +
         rules_of(identity) +
         "    </allow_rule>\n    <default>DENY</default>\n  </grant></permissions>\n</dds>\n";
}

}  // namespace cairn
