// SPDX-License-Identifier: Apache-2.0
#include "server/service/rights_verbs.h"

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <string_view>

#include "common/base/utc.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr size_t kMostEntries = 500;  ///< of an audit page

/// An error inside, turned into a Result at the border of this file.
struct Refused {
  Error error;
};

[[noreturn]] void refuse(ErrorCode code, std::string why) {
  throw Refused{{code, std::move(why)}};
}

template <typename T>
T taken(Result<T> result) {
  if (!result) throw Refused{result.error()};
  return std::move(*result);
}

void demand(const Status& status) {
  if (!status) throw Refused{status.error()};
}

/// Empty where there is none.
std::string text_of(const json& request, const char* key) {
  const auto it = request.find(key);
  if (it == request.end()) return {};
  if (!it->is_string()) refuse(ErrorCode::kUsage, "'" + std::string(key) + "' is no text");
  return it->get<std::string>();
}

std::string needed(const json& request, const char* key) {
  std::string text = text_of(request, key);
  if (text.empty()) refuse(ErrorCode::kUsage, "'" + std::string(key) + "' is missing");
  return text;
}

std::optional<bool> truth_of(const json& request, const char* key) {
  const auto it = request.find(key);
  if (it == request.end() || it->is_null()) return std::nullopt;
  if (!it->is_boolean()) refuse(ErrorCode::kUsage, "'" + std::string(key) + "' is neither true nor false");
  return it->get<bool>();
}

double number_of(const json& value, const char* what) {
  if (!value.is_number()) refuse(ErrorCode::kUsage, std::string(what) + " is no number");
  return value.get<double>();
}

Eigen::Vector3d place_of(const json& value) {
  if (!value.is_array() || value.size() != 3) refuse(ErrorCode::kUsage, "a place has three numbers");
  return {number_of(value[0], "x"), number_of(value[1], "y"), number_of(value[2], "z")};
}

NamedMap map_of(const json& request, const FindMap& find) {
  const std::string wanted = needed(request, "map");
  if (auto map = find(wanted)) return std::move(*map);
  refuse(ErrorCode::kNotFound, "no map is called '" + wanted + "'; `cairnctl maps` lists them");
}

/// Nothing: "all".
std::optional<NamedMap> map_or_all(const json& request, const FindMap& find) {
  if (needed(request, "map") == "all") return std::nullopt;
  return map_of(request, find);
}

Extent extent_of(const json& within, const std::optional<NamedMap>& map) {
  if (!within.is_object()) refuse(ErrorCode::kUsage, "'within' is no extent");
  if (const auto box = within.find("box"); box != within.end()) {
    if (!box->is_array() || box->size() != 2) refuse(ErrorCode::kUsage, "a box has two corners");
    return Box{place_of((*box)[0]), place_of((*box)[1])};
  }
  if (const auto center = within.find("center"); center != within.end())
    return Sphere{place_of(*center), number_of(within.value("radius", json()), "the radius")};
  if (const auto margin = within.find("margin"); margin != within.end() && map) {
    const double room = number_of(*margin, "the margin");
    if (!(room >= 0)) refuse(ErrorCode::kUsage, "the margin is negative");
    return with_margin(map->bounds, room);
  }
  refuse(ErrorCode::kUsage, "'within' has a box, a center and a radius, or a margin around the map's bounds");
}

std::string words_for(const std::optional<NamedMap>& map) {
  return map ? "map " + map->name : "all maps";
}

/// What a change is made of: each verb is a function of this.
struct Change {
  const json& request;
  const FindMap& find;
  Timestamp now;
  std::string operator_name;
  RightsChange& out;
};

void grant(const Change& c) {
  const auto map = map_or_all(c.request, c.find);
  Grant grant;
  grant.subject = taken(parse_subject(needed(c.request, "to")));
  if (map) grant.map = map->id;
  grant.right = taken(parse_right(needed(c.request, "right")));
  if (const auto within = c.request.find("within"); within != c.request.end())
    grant.extent = extent_of(*within, map);
  if (const std::string until = text_of(c.request, "until"); !until.empty()) {
    grant.expires = taken(parse_utc(until));
    if (*grant.expires <= c.now) refuse(ErrorCode::kUsage, until + " is over already");
  }
  grant.by = c.operator_name;
  grant.since = c.now;
  c.out.entry.object = to_string(grant.subject) + ", " + words_for(map) + ": " +
                       std::string(to_string(grant.right)) +
                       (grant.extent ? " within " + describe(*grant.extent) : "") +
                       (grant.expires ? " until " + to_utc(*grant.expires) : "");
  demand(c.out.rights.grant(std::move(grant)));
}

void revoke(const Change& c) {
  // The grants of a map that was deleted are still there, under its id.
  const std::string wanted = needed(c.request, "map");
  std::optional<MapId> map;
  std::string words = "all maps";
  if (wanted != "all") {
    const auto known = c.find(wanted);
    const auto bytes = known ? Result<std::array<uint8_t, 16>>(known->id.bytes) : from_hex(wanted);
    if (!bytes) refuse(ErrorCode::kNotFound, "no map is called '" + wanted + "'; `cairnctl maps` lists them");
    map = MapId{*bytes};
    words = "map " + (known ? known->name : wanted);
  }
  const Subject subject = taken(parse_subject(needed(c.request, "to")));
  demand(c.out.rights.revoke(subject, map));
  c.out.entry.object = to_string(subject) + ", " + words;
}

void set_standard(const Change& c) {
  const Rights::Table now = c.out.rights.table();
  const std::string word = text_of(c.request, "right");
  const Right right = word.empty() ? now.standard : taken(parse_right(word));
  const bool may_create = truth_of(c.request, "create").value_or(now.may_create);
  c.out.rights.set_standard(right, may_create);
  c.out.entry.object =
      "everyone: " + std::string(to_string(right)) + (may_create ? ", makes maps" : ", makes no maps");
}

void let_create(const Change& c) {
  const Subject subject = taken(parse_subject(needed(c.request, "to")));
  const std::optional<bool> may = truth_of(c.request, "may");
  demand(c.out.rights.let_create(subject, may));
  c.out.entry.object = to_string(subject) + (may ? (*may ? ": yes" : ": no") : ": as the others");
}

void put_group(const Change& c) {
  std::set<std::string> members;
  const auto list = c.request.find("members");
  if (list == c.request.end() || !list->is_array())
    refuse(ErrorCode::kUsage, "'members' is no list of names");
  for (const json& member : *list) {
    if (!member.is_string()) refuse(ErrorCode::kUsage, "a member is a name");
    members.insert(member.get<std::string>());
  }
  const std::string group = needed(c.request, "group");
  c.out.entry.object = "group " + group + ":";
  for (const std::string& member : members) c.out.entry.object += " " + member;
  demand(c.out.rights.put_group(group, std::move(members)));
}

void freeze(const Change& c) {
  const NamedMap map = map_of(c.request, c.find);
  const std::string why = text_of(c.request, "why");
  demand(c.out.rights.freeze(map.id, Closure{c.operator_name, c.now, why}));
  c.out.entry.object = "map " + map.name + (why.empty() ? "" : ": " + why);
}

void unfreeze(const Change& c) {
  const NamedMap map = map_of(c.request, c.find);
  if (!c.out.rights.table().frozen.contains(map.id))
    refuse(ErrorCode::kNotFound, "map " + map.name + " is not frozen");
  demand(c.out.rights.freeze(map.id, std::nullopt));
  c.out.entry.object = "map " + map.name;
}

void block(const Change& c) {
  const std::string client = needed(c.request, "client");
  const std::string why = text_of(c.request, "why");
  demand(c.out.rights.block(client, Closure{c.operator_name, c.now, why}));
  c.out.entry.object = "client " + client + (why.empty() ? "" : ": " + why);
}

void unblock(const Change& c) {
  const std::string client = needed(c.request, "client");
  if (!c.out.rights.table().blocked.contains(client))
    refuse(ErrorCode::kNotFound, "client " + client + " is not blocked");
  demand(c.out.rights.block(client, std::nullopt));
  c.out.entry.object = "client " + client;
}

void welcome_proposals(const Change& c) {
  const auto map = map_or_all(c.request, c.find);
  const std::optional<bool> welcome = truth_of(c.request, "welcome");
  if (!map && !welcome) refuse(ErrorCode::kUsage, "'welcome' is missing: in all maps it is true or false");
  c.out.rights.welcome_proposals(map ? std::optional(map->id) : std::nullopt, welcome);
  c.out.entry.object = words_for(map) + (welcome ? (*welcome ? ": on" : ": off") : ": as in all maps");
}

struct Verb {
  std::string_view name;
  void (*change)(const Change&);
};
constexpr std::array kVerbs{
    Verb{"rights-grant", grant},          Verb{"rights-revoke", revoke},
    Verb{"rights-default", set_standard}, Verb{"rights-create", let_create},
    Verb{"rights-group", put_group},      Verb{"map-freeze", freeze},
    Verb{"map-unfreeze", unfreeze},       Verb{"client-block", block},
    Verb{"client-unblock", unblock},      Verb{"proposals-welcome", welcome_proposals}};

const Verb* find_verb(std::string_view name) {
  const auto* found =
      std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& v) { return v.name == name; });
  return found == kVerbs.end() ? nullptr : found;
}

/// "rights-grant" as the operator writes it.
std::string action_of(std::string verb) {
  std::replace(verb.begin(), verb.end(), '-', ' ');
  return verb;
}

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

}  // namespace

bool changes_rights(const std::string& verb) {
  return find_verb(verb) != nullptr;
}

Result<RightsChange> change_rights(const Rights& rights, const json& request,
                                   const std::string& operator_name, const FindMap& find, Timestamp now) {
  const auto wanted = request.find("verb");
  const std::string verb = wanted != request.end() && wanted->is_string() ? wanted->get<std::string>() : "";
  const Verb* known = find_verb(verb);
  if (known == nullptr) return fail(ErrorCode::kUsage, "no request about rights is called '" + verb + "'");
  RightsChange change{rights, {0, now, "operator " + operator_name, action_of(verb), {}, "done"}, {}};
  try {
    known->change({request, find, now, operator_name, change});
  } catch (const Refused& refused) {
    return tl::unexpected(refused.error);
  }
  change.answer = {{"done", change.entry.action + ": " + change.entry.object}};
  return change;
}

json describe_rights(const Rights& rights, const std::function<std::string(const MapId&)>& name_of,
                     Timestamp now) {
  const Rights::Table table = rights.table();
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
    content["grants"].push_back(describe(grant, grant.map ? name_of(*grant.map) : "", now));
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

Result<json> explain_rights(const Rights& rights, const json& request, const FindMap& find, Timestamp now) {
  try {
    const NamedMap map = map_of(request, find);
    const Subject client = taken(parse_subject(needed(request, "client")));
    if (client.kind != Subject::Kind::kClient)
      refuse(ErrorCode::kUsage, "an explanation is of one client, not of " + to_string(client));
    const Ruling ruling = rights.rule(client.name, map.id, now);
    json content{{"client", client.name},
                 {"map", map.name},
                 {"right", to_string(ruling.right)},
                 {"reason", ruling.reason}};
    if (ruling.extent) content["within"] = describe(*ruling.extent);
    if (ruling.expires) content["until"] = to_utc(*ruling.expires);
    constexpr std::array kParts{"decides", "has expired", "is outweighed"};
    json& rules = content["rules"] = json::array();
    for (const RuleSeen& seen : rights.explain(client.name, map.id, now))
      rules.push_back({{"rule", seen.rule}, {"part", kParts.at(static_cast<size_t>(seen.part))}});
    const Ruling creating = rights.rule_on_creating(client.name);
    content["create"] = creating.right != Right::kNone;
    content["create_reason"] = creating.reason;
    return content;
  } catch (const Refused& refused) {
    return tl::unexpected(refused.error);
  }
}

Result<AuditQuery> audit_query_of(const json& request) {
  try {
    AuditQuery query{
        text_of(request, "who"), text_of(request, "action"), text_of(request, "object"), {}, {}, {}};
    if (const std::string from = text_of(request, "from"); !from.empty()) query.from = taken(parse_utc(from));
    if (const std::string until = text_of(request, "until"); !until.empty())
      query.until = taken(parse_utc(until));
    const auto before = request.find("before");
    if (before != request.end() && before->is_number_integer()) query.before_number = before->get<int64_t>();
    const auto limit = request.find("limit");
    if (limit != request.end() && limit->is_number_unsigned()) query.limit = limit->get<size_t>();
    query.limit = std::clamp<size_t>(query.limit, 1, kMostEntries);
    return query;
  } catch (const Refused& refused) {
    return tl::unexpected(refused.error);
  }
}

json describe(const AuditEntry& entry) {
  return {{"number", entry.number}, {"time", to_utc(entry.time)}, {"who", entry.who},
          {"action", entry.action}, {"object", entry.object},     {"outcome", entry.outcome}};
}

}  // namespace cairn
