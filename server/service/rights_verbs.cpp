// SPDX-License-Identifier: Apache-2.0
#include "server/service/rights_verbs.h"

#include <algorithm>
#include <array>
#include <variant>
#include <vector>

#include "common/base/overloaded.h"
#include "common/base/suggestion.h"
#include "common/base/utc.h"

namespace cairn {
namespace {

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

NamedMap named(const std::string& wanted, const FindMap& find) {
  if (auto map = find(wanted)) return std::move(*map);
  refuse(ErrorCode::kNotFound, "no map is called '" + wanted + "'; `cairnctl maps` lists them");
}

/// The map that is called so; nothing: "all".
std::optional<NamedMap> map_or_all(const std::string& wanted, const FindMap& find) {
  if (wanted == "all") return std::nullopt;
  return named(wanted, find);
}

Extent extent_of(const asked::Within& within, const std::optional<NamedMap>& map) {
  if (const auto* box = std::get_if<Box>(&within)) return *box;
  if (const auto* sphere = std::get_if<Sphere>(&within)) return *sphere;
  if (!map) refuse(ErrorCode::kUsage, asked::kWhatWithinHas);
  return with_margin(map->bounds, std::get<asked::Margin>(within).around);
}

std::string words_for(const std::optional<NamedMap>& map) {
  return map ? "map " + map->name : "all maps";
}

/// "rights-grant" as the operator writes it.
std::string action_of(std::string verb) {
  std::ranges::replace(verb, '-', ' ');
  return verb;
}

/// Makes a change of what is asked: each verb is one of take().
struct Changer {
  const FindMap& find;
  Timestamp now;
  const std::string& operator_name;
  RightsChange& out;

  void take(const asked::GrantRight& ask) const {
    const auto map = map_or_all(ask.map, find);
    Grant grant;
    grant.subject = taken(parse_subject(ask.to));
    if (map) grant.map = map->id;
    grant.right = taken(parse_right(ask.right));
    if (ask.within) grant.extent = extent_of(*ask.within, map);
    if (!ask.until.empty()) {
      grant.expires = taken(parse_utc(ask.until));
      if (*grant.expires <= now) refuse(ErrorCode::kUsage, ask.until + " is over already");
    }
    put(std::move(grant), words_for(map));
  }

  /// `where`: "map desk".
  void put(Grant grant, const std::string& where) const {
    grant.by = operator_name;
    grant.since = now;
    out.entry.object = to_string(grant.subject) + ", " + where + ": " + std::string(to_string(grant.right)) +
                       (grant.extent ? " within " + describe(*grant.extent) : "") +
                       (grant.expires ? " until " + to_utc(*grant.expires) : "");
    demand(out.rights.grant(std::move(grant)));
  }

  /// What somebody may do in a map while nobody has frozen it or blocked them: of a group or everyone, what
  /// was granted to them, else to everyone, for the map before all maps, else the site's default.
  Ruling present(const Subject& subject, const MapId& map) const {
    if (subject.kind == Subject::Kind::kClient) {
      return open_ruling(out.rights, subject.name, map, now);
    }
    const Rights::Table table = out.rights.table();
    for (const std::optional<MapId>& object : {std::optional(map), std::optional<MapId>()}) {
      for (const Subject& whose : {subject, Subject{}}) {
        const auto found = std::ranges::find_if(table.grants, [&](const Grant& grant) {
          const bool is_over = grant.expires && *grant.expires <= now;
          return grant.subject == whose && grant.map == object && !is_over;
        });
        if (found != table.grants.end()) return {found->right, found->extent, found->expires, {}};
      }
    }
    return {table.standard, {}, {}, {}};
  }

  /// What `client` may do in a map if nobody has frozen it or blocked the client.
  Ruling open_ruling(Rights rights, const std::string& client, const MapId& map, Timestamp at) const {
    demand(rights.freeze(map, std::nullopt));
    demand(rights.block(client, std::nullopt));
    return rights.rule(client, map, at);
  }

  /// Now, and whenever a grant expires from now on.
  std::set<Timestamp> times_of_change(const Grant& added) const {
    std::set<Timestamp> times{now};
    if (added.expires) times.insert(*added.expires);
    for (const Grant& grant : out.rights.table().grants)
      if (grant.expires && *grant.expires > now) times.insert(*grant.expires);
    return times;
  }

  /// An extent is a grant for this map, which comes before those for all maps; and of several groups the one
  /// that grants most counts. So it may give somebody more than he had, now or once another grant is over.
  void demand_none_is_raised(const Grant& grant, const MapId& map) const {
    const std::vector<Grant> grants = out.rights.table().grants;
    const auto own = std::ranges::find_if(
        grants, [&](const Grant& one) { return one.subject == grant.subject && one.map == grant.map; });
    const auto is_raised = [&](const Ruling& had, const Ruling& has) {
      if (has.right > had.right) return true;
      const bool is_others = own == grants.end() || had.extent != own->extent;
      return has.right > Right::kRead && had.extent && is_others && has.extent != had.extent;
    };
    Rights after = out.rights;
    demand(after.grant(grant));
    for (const std::string& client : out.rights.named_clients()) {
      for (const Timestamp at : times_of_change(grant)) {
        const Ruling had = open_ruling(out.rights, client, map, at);
        if (!is_raised(had, open_ruling(after, client, map, at))) continue;
        refuse(ErrorCode::kUsage,
               "client " + client + " has the right '" + std::string(to_string(had.right)) + "' here" +
                   (had.extent ? " within " + describe(*had.extent) : "") +
                   (at > now ? " from " + to_utc(at) + " on" : "") + ", which an extent for " +
                   to_string(grant.subject) + " would raise: grant that client its right in this map first");
      }
    }
  }

  void take(const asked::LimitGrowth& ask) const {
    const NamedMap map = named(ask.map, find);
    Grant grant;
    grant.subject = taken(parse_subject(ask.to));
    grant.map = map.id;
    const Ruling now_may = present(grant.subject, map.id);
    if (now_may.right != Right::kAdd && now_may.right != Right::kWrite) {
      refuse(ErrorCode::kUsage, to_string(grant.subject) + " has the right '" +
                                    std::string(to_string(now_may.right)) + "' in map " + map.name +
                                    "; only 'add' and 'write' can be kept within an extent: `cairnctl rights "
                                    "grant` gives one of them, with the same options");
    }
    grant.right = now_may.right;
    grant.expires = now_may.expires;
    if (ask.within) grant.extent = extent_of(*ask.within, map);
    demand_none_is_raised(grant, map.id);
    put(std::move(grant), "map " + map.name);
  }

  void take(const asked::RevokeRight& ask) const {
    // The grants of a map that was deleted are still there, under its id.
    std::optional<MapId> map;
    std::string words = "all maps";
    if (ask.map != "all") {
      const auto known = find(ask.map);
      const auto bytes = known ? Result<std::array<uint8_t, 16>>(known->id.bytes) : from_hex(ask.map);
      if (!bytes)
        refuse(ErrorCode::kNotFound, "no map is called '" + ask.map + "'; `cairnctl maps` lists them");
      map = MapId{*bytes};
      words = "map " + (known ? known->name : ask.map);
    }
    const Subject subject = taken(parse_subject(ask.to));
    demand(out.rights.revoke(subject, map));
    out.entry.object = to_string(subject) + ", " + words;
  }

  void take(const asked::SetStandard& ask) const {
    const Rights::Table table = out.rights.table();
    const Right right = ask.right.empty() ? table.standard : taken(parse_right(ask.right));
    const bool may_create = ask.create.value_or(table.may_create);
    out.rights.set_standard(right, may_create);
    out.entry.object =
        "everyone: " + std::string(to_string(right)) + (may_create ? ", makes maps" : ", makes no maps");
  }

  void take(const asked::LetCreate& ask) const {
    const Subject subject = taken(parse_subject(ask.to));
    demand(out.rights.let_create(subject, ask.may));
    out.entry.object = to_string(subject) + (ask.may ? (*ask.may ? ": yes" : ": no") : ": as the others");
  }

  void take(const asked::PutGroup& ask) const {
    out.entry.object = "group " + ask.group + ":";
    for (const std::string& member : ask.members) out.entry.object += " " + member;
    demand(out.rights.put_group(ask.group, ask.members));
  }

  void take(const asked::FreezeMap& ask) const {
    const NamedMap map = named(ask.map, find);
    const Rights::Table table = out.rights.table();
    const auto before = table.frozen.find(map.id);
    // Who freezes it once more without a word does not take back what was said.
    const bool is_said = ask.why.empty() && before != table.frozen.end();
    const Closure closure = is_said ? before->second : Closure{operator_name, now, ask.why};
    demand(out.rights.freeze(map.id, closure));
    out.entry.object = "map " + map.name + (closure.why.empty() ? "" : ": " + closure.why);
  }

  void take(const asked::UnfreezeMap& ask) const {
    const NamedMap map = named(ask.map, find);
    if (!out.rights.table().frozen.contains(map.id))
      refuse(ErrorCode::kNotFound, "map " + map.name + " is not frozen");
    demand(out.rights.freeze(map.id, std::nullopt));
    out.entry.object = "map " + map.name;
  }

  void take(const asked::BlockClient& ask) const {
    demand(out.rights.block(ask.client, Closure{operator_name, now, ask.why}));
    out.entry.object = "client " + ask.client + (ask.why.empty() ? "" : ": " + ask.why);
  }

  void take(const asked::UnblockClient& ask) const {
    if (!out.rights.table().blocked.contains(ask.client))
      refuse(ErrorCode::kNotFound, "client " + ask.client + " is not blocked");
    demand(out.rights.block(ask.client, std::nullopt));
    out.entry.object = "client " + ask.client;
  }

  void take(const asked::WelcomeProposals& ask) const {
    const auto map = map_or_all(ask.map, find);
    if (!map && !ask.welcome)
      refuse(ErrorCode::kUsage, "'welcome' is missing: in all maps it is true or false");
    out.rights.welcome_proposals(map ? std::optional(map->id) : std::nullopt, ask.welcome);
    out.entry.object =
        words_for(map) + (ask.welcome ? (*ask.welcome ? ": on" : ": off") : ": as in all maps");
  }
};

/// Whom a rule is to be about. What is taken back names nobody who would have to be there.
std::vector<Subject> named_in(const asked::ChangeRights& ask) {
  using Named = std::vector<Subject>;
  const auto one = [](const std::string& words) {
    const auto subject = parse_subject(words);
    return subject ? Named{*subject} : Named{};
  };
  const Overloaded cases{[&](const asked::GrantRight& grant) { return one(grant.to); },
                         [&](const asked::LimitGrowth& limit) { return one(limit.to); },
                         [&](const asked::LetCreate& let) { return let.may ? one(let.to) : Named{}; },
                         [&](const asked::BlockClient& block) { return one(block.client); },
                         [](const asked::PutGroup& put) {
                           Named members;
                           for (const std::string& name : put.members)
                             members.push_back({Subject::Kind::kClient, name});
                           return members;
                         },
                         [](const auto&) { return Named{}; }};
  return std::visit(cases, ask.what);
}

/// A note on a client that has no keys and has not connected, or whose keys are revoked; else empty.
std::string note_on_client(const std::string& name, const KnownClients& known) {
  if (known.revoked.contains(name))
    return "the keys of client " + name + " are revoked: it may do nothing, whatever the rules say";
  if (known.names.contains(name)) return {};
  return "nobody called '" + name + "' has " + (known.have_keys ? "keys here or has " : "") +
         "connected since the server started" + did_you_mean(name, {known.names.begin(), known.names.end()});
}

std::string note_on_group(const std::string& name, const std::set<std::string>& groups) {
  if (groups.contains(name)) return {};
  return "no group is called '" + name + "' yet; `cairnctl rights group " + name + " CLIENT...` makes it" +
         did_you_mean(name, {groups.begin(), groups.end()});
}

}  // namespace

std::string note_on_names(const Rights& rights, const asked::ChangeRights& ask, const KnownClients& known) {
  constexpr size_t kMostTold = 5;
  std::vector<std::string> notes;
  for (const Subject& subject : named_in(ask)) {
    std::string note;
    if (subject.kind == Subject::Kind::kClient) note = note_on_client(subject.name, known);
    if (subject.kind == Subject::Kind::kGroup) note = note_on_group(subject.name, rights.groups());
    if (!note.empty()) notes.push_back(std::move(note));
  }
  std::string told;
  for (size_t i = 0; i < std::min(notes.size(), kMostTold); ++i) told += (i > 0 ? "; " : "") + notes[i];
  if (notes.size() > kMostTold) told += "; and " + std::to_string(notes.size() - kMostTold) + " more";
  return told;
}

Result<RightsChange> change_rights(const Rights& rights, const asked::ChangeRights& ask,
                                   const std::string& operator_name, const FindMap& find, Timestamp now) {
  RightsChange change{rights, {0, now, "operator " + operator_name, action_of(ask.verb), {}, "done"}};
  const Changer changer{find, now, operator_name, change};
  try {
    std::visit([&changer](const auto& what) { changer.take(what); }, ask.what);
  } catch (const Refused& refused) {
    return tl::unexpected(refused.error);
  }
  return change;
}

Result<told::ExplainedRights> explain_rights(const Rights& rights, const asked::ExplainRights& ask,
                                             const FindMap& find, const KnownClients& known, Timestamp now) {
  try {
    const NamedMap map = named(ask.map, find);
    const Subject client = taken(parse_subject(ask.client));
    if (client.kind != Subject::Kind::kClient)
      refuse(ErrorCode::kUsage, "an explanation is of one client, not of " + to_string(client));
    return told::ExplainedRights{client.name,
                                 map.name,
                                 rights.rule(client.name, map.id, now),
                                 rights.explain(client.name, map.id, now),
                                 rights.rule_on_creating(client.name),
                                 rights.memberships(client.name),
                                 note_on_client(client.name, known)};
  } catch (const Refused& refused) {
    return tl::unexpected(refused.error);
  }
}

}  // namespace cairn
