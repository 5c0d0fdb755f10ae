// SPDX-License-Identifier: Apache-2.0
#include "server/access/rights_file.h"

#include <algorithm>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/utc.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

using nlohmann::json;
using nlohmann::ordered_json;

constexpr int kFormat = 1;

// --- writing

ordered_json to_json(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

ordered_json to_json(const Extent& extent) {
  if (const Box* box = std::get_if<Box>(&extent)) return {{"box", {to_json(box->min), to_json(box->max)}}};
  const auto& sphere = std::get<Sphere>(extent);
  return {{"center", to_json(sphere.center)}, {"radius", sphere.radius}};
}

std::string to_word(const std::optional<MapId>& map) {
  return map ? to_hex(map->bytes) : "all";
}

ordered_json to_json(const Grant& grant) {
  ordered_json rule{
      {"to", to_string(grant.subject)}, {"map", to_word(grant.map)}, {"right", to_string(grant.right)}};
  if (grant.extent) rule["within"] = to_json(*grant.extent);
  if (grant.expires) rule["expires"] = to_utc(*grant.expires);
  rule["by"] = grant.by;
  rule["since"] = to_utc(grant.since);
  return rule;
}

ordered_json to_json(const char* key, std::string what, const Closure& closure) {
  ordered_json rule{{key, std::move(what)}, {"by", closure.by}, {"since", to_utc(closure.since)}};
  if (!closure.why.empty()) rule["why"] = closure.why;
  return rule;
}

/// `"name": [` and a line for each.
void write_list(std::string_view name, const std::vector<ordered_json>& rules, std::string* text) {
  *text += ",\n \"" + std::string(name) + "\": [";
  for (size_t i = 0; i < rules.size(); ++i) *text += (i == 0 ? "\n  " : ",\n  ") + rules[i].dump();
  *text += rules.empty() ? "]" : "\n ]";
}

// --- reading: an error is thrown inside, and turned into a Result at the border.

struct Wrong {
  std::string what;
};

void allow_keys(const json& rule, std::initializer_list<std::string_view> keys) {
  if (!rule.is_object()) throw Wrong{"it is no object"};
  for (const auto& [key, value] : rule.items()) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end())
      throw Wrong{"unknown key '" + one_line(cut_text(key, 40)) + "'"};
  }
}

std::string text_of(const json& rule, const char* key) {
  const auto found = rule.find(key);
  if (found == rule.end() || !found->is_string())
    throw Wrong{"'" + std::string(key) + "' is missing or no text"};
  return found->get<std::string>();
}

template <typename T>
T taken(Result<T> result) {
  if (!result) throw Wrong{result.error().message};
  return std::move(*result);
}

void demand(const Status& status) {
  if (!status) throw Wrong{status.error().message};
}

bool truth_of(const json& rule, const char* key) {
  const auto found = rule.find(key);
  if (found == rule.end() || !found->is_boolean())
    throw Wrong{"'" + std::string(key) + "' is missing or neither true nor false"};
  return found->get<bool>();
}

Eigen::Vector3d vector_of(const json& value) {
  if (!value.is_array() || value.size() != 3) throw Wrong{"a place has three numbers"};
  Eigen::Vector3d v;
  for (size_t i = 0; i < 3; ++i) {
    if (!value[i].is_number()) throw Wrong{"a place has three numbers"};
    v[static_cast<Eigen::Index>(i)] = value[i].get<double>();
  }
  return v;
}

Extent extent_of(const json& value) {
  if (value.is_object() && value.contains("box")) {
    allow_keys(value, {"box"});
    const json& corners = value["box"];
    if (!corners.is_array() || corners.size() != 2) throw Wrong{"a box has two corners"};
    return Box{vector_of(corners[0]), vector_of(corners[1])};
  }
  allow_keys(value, {"center", "radius"});
  if (!value.contains("center") || !value.contains("radius") || !value["radius"].is_number())
    throw Wrong{"'within' has a box, or a center and a radius"};
  return Sphere{vector_of(value["center"]), value["radius"].get<double>()};
}

MapId map_of(const std::string& word) {
  return MapId{taken(from_hex(word))};
}

Grant grant_of(const json& rule) {
  allow_keys(rule, {"to", "map", "right", "within", "expires", "by", "since"});
  Grant grant;
  grant.subject = taken(parse_subject(text_of(rule, "to")));
  if (const std::string map = text_of(rule, "map"); map != "all") grant.map = map_of(map);
  grant.right = taken(parse_right(text_of(rule, "right")));
  if (rule.contains("within")) grant.extent = extent_of(rule["within"]);
  if (rule.contains("expires")) grant.expires = taken(parse_utc(text_of(rule, "expires")));
  grant.by = text_of(rule, "by");
  grant.since = taken(parse_utc(text_of(rule, "since")));
  return grant;
}

Closure closure_of(const json& rule, std::string_view key) {
  allow_keys(rule, {key, "by", "since", "why"});
  Closure closure{text_of(rule, "by"), taken(parse_utc(text_of(rule, "since"))), {}};
  if (rule.contains("why")) closure.why = text_of(rule, "why");
  return closure;
}

/// Calls `take` with each rule of a list; what is wrong with one is told with its number.
template <typename Take>
void for_each_rule(const json& all, const char* list, const Take& take) {
  const auto found = all.find(list);
  if (found == all.end()) return;
  if (!found->is_array()) throw Wrong{"'" + std::string(list) + "' is no list"};
  if (found->size() > kMostRules) throw Wrong{"'" + std::string(list) + "' has too many rules"};
  size_t number = 0;
  for (const json& rule : *found) {
    ++number;
    try {
      take(rule);
    } catch (const Wrong& wrong) {
      throw Wrong{"'" + std::string(list) + "', rule " + std::to_string(number) + ": " + wrong.what};
    }
  }
}

void read_members(const json& rule, Rights* rights) {
  allow_keys(rule, {"group", "members"});
  const auto list = rule.find("members");
  if (list == rule.end() || !list->is_array() || list->empty() || list->size() > kMostRules)
    throw Wrong{"'members' is missing or no list of names"};
  std::set<std::string> members;
  for (const json& member : *list) {
    if (!member.is_string()) throw Wrong{"a member is a name"};
    members.insert(member.get<std::string>());
  }
  demand(rights->put_group(text_of(rule, "group"), std::move(members)));
}

Rights rights_of(const json& all) {
  allow_keys(all, {"format", "default", "create", "groups", "grants", "creators", "frozen", "blocked",
                   "proposals", "proposals_in"});
  const auto format = all.find("format");
  if (format == all.end() || !format->is_number_integer()) throw Wrong{"'format' is missing"};
  if (*format != kFormat)
    throw Wrong{"'format' is " + format->dump() + ", known is 1; install a newer version"};
  Rights rights(taken(parse_right(text_of(all, "default"))), truth_of(all, "create"));
  for_each_rule(all, "groups", [&](const json& rule) { read_members(rule, &rights); });
  for_each_rule(all, "grants", [&](const json& rule) { demand(rights.grant(grant_of(rule))); });
  for_each_rule(all, "creators", [&](const json& rule) {
    allow_keys(rule, {"to", "may"});
    demand(rights.let_create(taken(parse_subject(text_of(rule, "to"))), truth_of(rule, "may")));
  });
  for_each_rule(all, "frozen", [&](const json& rule) {
    Closure closure = closure_of(rule, "map");
    demand(rights.freeze(map_of(text_of(rule, "map")), std::move(closure)));
  });
  for_each_rule(all, "blocked", [&](const json& rule) {
    Closure closure = closure_of(rule, "client");
    demand(rights.block(text_of(rule, "client"), std::move(closure)));
  });
  if (all.contains("proposals")) rights.welcome_proposals(std::nullopt, truth_of(all, "proposals"));
  for_each_rule(all, "proposals_in", [&](const json& rule) {
    allow_keys(rule, {"map", "welcome"});
    rights.welcome_proposals(map_of(text_of(rule, "map")), truth_of(rule, "welcome"));
  });
  return rights;
}

}  // namespace

std::string to_text(const Rights& rights) {
  const Rights::Table table = rights.table();
  std::string text = "{\"format\": " + std::to_string(kFormat) + ",\n \"default\": \"" +
                     std::string(to_string(table.standard)) +
                     "\", \"create\": " + (table.may_create ? "true" : "false");
  std::vector<ordered_json> rules;
  const auto flush = [&](std::string_view name) { write_list(name, std::exchange(rules, {}), &text); };
  for (const auto& [name, members] : table.groups) rules.push_back({{"group", name}, {"members", members}});
  flush("groups");
  for (const Grant& grant : table.grants) rules.push_back(to_json(grant));
  flush("grants");
  for (const auto& [subject, may] : table.creators)
    rules.push_back({{"to", to_string(subject)}, {"may", may}});
  flush("creators");
  for (const auto& [map, closure] : table.frozen) rules.push_back(to_json("map", to_hex(map.bytes), closure));
  flush("frozen");
  for (const auto& [client, closure] : table.blocked) rules.push_back(to_json("client", client, closure));
  flush("blocked");
  // Left out where nothing is said: an earlier version reads the file, then.
  if (table.proposals) text += ",\n \"proposals\": true";
  for (const auto& [map, welcome] : table.proposals_in)
    rules.push_back({{"map", to_hex(map.bytes)}, {"welcome", welcome}});
  if (!rules.empty()) flush("proposals_in");
  return text + "\n}\n";
}

Result<Rights> read_rights(std::string_view text) {
  constexpr int kMostDepth = 8;  // no rule nests as deeply
  const auto limit_depth = [](int depth, json::parse_event_t, const json&) {
    if (depth > kMostDepth) throw Wrong{"nested too deeply"};
    return true;
  };
  try {
    const json all = json::parse(text.begin(), text.end(), limit_depth, false);
    if (all.is_discarded()) throw Wrong{"no JSON"};
    return rights_of(all);
  } catch (const Wrong& wrong) {
    return fail(ErrorCode::kDamaged, "the rights cannot be read: " + wrong.what);
  }
}

}  // namespace cairn
