// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "common/base/utc.h"
#include "server/service/admin_json.h"

namespace cairn {

using nlohmann::json;

namespace {

json describe(const Grant& grant, const std::string& map_name, Timestamp now) {
  json rule{{"to", to_string(grant.subject)},
            {"right", to_string(grant.right)},
            {"by", grant.by},
            {"since", to_utc(grant.since)}};
  if (grant.map) {
    rule["map"] = to_hex(grant.map->bytes);
    if (!map_name.empty()) rule["name"] = map_name;
  }
  if (grant.extent) rule["within"] = describe(*grant.extent);
  if (grant.expires) {
    rule["until"] = to_utc(*grant.expires);
    rule["expired"] = *grant.expires <= now;
  }
  return rule;
}

json describe(const Closure& closure) {
  return {{"by", closure.by}, {"since", to_utc(closure.since)}, {"why", closure.why}};
}

json describe(const RuleSeen& seen) {
  constexpr std::array kParts{"decides", "has expired", "is outweighed"};
  return {{"rule", seen.rule}, {"part", kParts.at(static_cast<size_t>(seen.part))}};
}

json rules_of(const told::Rights& rights) {
  const auto name_of = [&rights](const MapId& map) {
    const auto known = rights.names.find(map);
    return known == rights.names.end() ? std::string() : known->second;
  };
  const Rights::Table& table = rights.table;
  json content{{"default", to_string(table.standard)},
               {"create", table.may_create},
               {"grants", json::array()},
               {"creators", json::array()},
               {"groups", json::array()},
               {"frozen", json::array()},
               {"blocked", json::array()},
               {"proposals", table.proposals},
               {"proposals_in", json::array()}};
  for (const Grant& grant : table.grants)
    content["grants"].push_back(describe(grant, grant.map ? name_of(*grant.map) : "", rights.now));
  for (const auto& [subject, may] : table.creators)
    content["creators"].push_back({{"to", to_string(subject)}, {"may", may}});
  for (const auto& [group, members] : table.groups)
    content["groups"].push_back({{"group", group}, {"members", members}});
  for (const auto& [map, closure] : table.frozen) {
    json& rule = content["frozen"].emplace_back(describe(closure));
    rule["map"] = to_hex(map.bytes);
    rule["name"] = name_of(map);
  }
  for (const auto& [client, closure] : table.blocked) {
    json& rule = content["blocked"].emplace_back(describe(closure));
    rule["client"] = client;
  }
  for (const auto& [map, welcome] : table.proposals_in)
    content["proposals_in"].push_back(
        {{"map", to_hex(map.bytes)}, {"name", name_of(map)}, {"welcome", welcome}});
  return content;
}

}  // namespace

/// All rules, for a person and for machines.
json describe(const told::Rights& rights) {
  json content = rules_of(rights);
  if (const auto& since = rights.secured_since) {
    content["secured"] = to_utc(*since);
    content["note"] =
        "a secured site since " + to_utc(*since) + "; what everyone had been allowed before is withdrawn";
  }
  if (!rights.is_kept) content["note"] = "this server has no --store: its rights are gone when it ends";
  return content;
}

/// What a client may do, and the rules that say so.
json describe(const told::ExplainedRights& explained) {
  const Ruling& ruling = explained.ruling;
  json content{{"client", explained.client},
               {"map", explained.map},
               {"right", to_string(ruling.right)},
               {"reason", ruling.reason}};
  if (ruling.extent) content["within"] = describe(*ruling.extent);
  if (ruling.expires) content["until"] = to_utc(*ruling.expires);
  json& rules = content["rules"] = json::array();
  for (const RuleSeen& seen : explained.rules) rules.push_back(describe(seen));
  json& groups = content["groups"] = json::array();
  for (const Membership& member : explained.groups)
    groups.push_back({{"group", member.group}, {"by_rights", member.by_rights}, {"by_keys", member.by_keys}});
  if (!explained.note.empty()) content["note"] = explained.note;
  content["create"] = explained.creating.right != Right::kNone;
  content["create_reason"] = explained.creating.reason;
  return content;
}

json describe(const AuditEntry& entry) {
  return {{"number", entry.number}, {"time", to_utc(entry.time)}, {"who", entry.who},
          {"action", entry.action}, {"object", entry.object},     {"outcome", entry.outcome}};
}

/// The next page begins before the last of these.
json describe(const told::Audit& audit) {
  ReplyPage page{"entries"};
  page.add_all("entries", audit.entries);
  return page.content();
}

}  // namespace cairn
