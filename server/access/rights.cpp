// SPDX-License-Identifier: Apache-2.0
#include "server/access/rights.h"

#include <algorithm>
#include <array>
#include <utility>

#include "common/base/suggestion.h"
#include "common/base/utc.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

constexpr std::array<std::string_view, 5> kRightWords{"none", "read", "add", "write", "manage"};

constexpr const char* kByMaking = "the server to the map's maker";  ///< in place of an operator's name

constexpr size_t kMaxWordsBytes = 1000;  // an operator's name, or a reason that a person reads

bool is_expired(const Grant& grant, Timestamp now) {
  return grant.expires && *grant.expires <= now;
}

Status check_subject(const Subject& subject) {
  if (subject.kind == Subject::Kind::kEveryone) {
    if (subject.name.empty()) return {};
    return fail(ErrorCode::kUsage, "'everyone' has no name beside it");
  }
  if (is_valid_name(subject.name)) return {};
  return fail(ErrorCode::kUsage,
              "'" + subject.name + "' can be no client and no group: names have 1 to 32 of a-z, 0-9 and -");
}

Status check_words(std::string_view words, const char* what) {
  if (words.size() > kMaxWordsBytes)
    return fail(ErrorCode::kUsage,
                std::string(what) + " takes " + std::to_string(kMaxWordsBytes) + " bytes at most");
  if (const auto fault = fault_of_text(words))
    return fail(ErrorCode::kUsage, std::string(what) + ": " + *fault);
  return {};
}

Status check_closure(const Closure& closure) {
  if (Status named = check_words(closure.by, "who does it"); !named) return named;
  return check_words(closure.why, "the reason");
}

Status check_grant(const Grant& grant) {
  if (Status named = check_subject(grant.subject); !named) return named;
  if (Status named = check_words(grant.by, "who grants it"); !named) return named;
  if (!grant.extent) return {};
  if (grant.right != Right::kAdd && grant.right != Right::kWrite) {
    return fail(ErrorCode::kUsage, "only 'add' and 'write' can be within an extent, not '" +
                                       std::string(to_string(grant.right)) + "'");
  }
  if (!grant.map)
    return fail(ErrorCode::kUsage, "an extent is of one map, each has a frame of its own: name the map");
  return check(*grant.extent);
}

std::string words_of(const Grant& grant) {
  std::string words(to_string(grant.right));
  if (grant.extent) words += " within " + describe(*grant.extent);
  if (grant.expires) words += " until " + to_utc(*grant.expires);
  return words;
}

/// "phone-1 may only read here".
std::string may_do(const std::string& client, Right right) {
  constexpr std::array<const char*, 5> kWhat{"do nothing", "only read", "only read and add", "write",
                                             "manage"};
  return client + " may " + kWhat.at(static_cast<size_t>(right)) + " here";
}

std::string reason_of(const Grant& grant, const std::string& client) {
  std::string words = may_do(client, grant.right);
  if (grant.extent) words += ", within " + describe(*grant.extent);
  if (grant.expires) words += " until " + to_utc(*grant.expires);
  words += ", as granted";
  if (grant.subject.kind != Subject::Kind::kClient) words += " to " + to_string(grant.subject);
  return words + " by " + grant.by;
}

std::string reason_of(std::string words, const Closure& closure) {
  if (!closure.by.empty()) words += " by " + closure.by;
  if (!closure.why.empty()) words += ": " + closure.why;
  return words;
}

}  // namespace

std::string_view to_string(Right right) {
  return kRightWords.at(static_cast<size_t>(right));
}

Result<Right> parse_right(std::string_view word) {
  const auto* found = std::find(kRightWords.begin(), kRightWords.end(), word);
  if (found != kRightWords.end()) return static_cast<Right>(found - kRightWords.begin());
  const std::vector<std::string> valid(kRightWords.begin(), kRightWords.end());
  return fail(ErrorCode::kUsage, "no right is called '" + std::string(word) + "'" +
                                     did_you_mean(word, valid) +
                                     "; there are none, read, add, write and manage");
}

std::string to_string(const Subject& subject) {
  switch (subject.kind) {
    case Subject::Kind::kEveryone:
      return "everyone";
    case Subject::Kind::kGroup:
      return "group " + subject.name;
    case Subject::Kind::kClient:
      break;
  }
  return "client " + subject.name;
}

Result<Subject> parse_subject(std::string_view words) {
  Subject subject;
  if (words.starts_with("group ")) {
    subject = {Subject::Kind::kGroup, std::string(words.substr(6))};
  } else if (words != "everyone") {
    const bool says_client = words.starts_with("client ");
    subject = {Subject::Kind::kClient, std::string(says_client ? words.substr(7) : words)};
  }
  if (Status named = check_subject(subject); !named) return tl::unexpected(named.error());
  return subject;
}

Status Rights::grant(Grant grant) {
  if (Status possible = check_grant(grant); !possible) return possible;
  const Key key{grant.subject, grant.map};
  grants_.insert_or_assign(key, std::move(grant));
  return {};
}

Status Rights::revoke(const Subject& subject, const std::optional<MapId>& map) {
  if (grants_.erase({subject, map}) > 0) return {};
  return fail(ErrorCode::kNotFound,
              "nothing is granted to " + to_string(subject) + (map ? " for this map" : " for all maps"));
}

Status Rights::let_create(const Subject& subject, std::optional<bool> may) {
  if (Status named = check_subject(subject); !named) return named;
  if (may) {
    creators_[subject] = *may;
  } else {
    creators_.erase(subject);
  }
  return {};
}

Status Rights::put_group(const std::string& name, std::set<std::string> members) {
  if (Status named = check_subject({Subject::Kind::kGroup, name}); !named) return named;
  for (const std::string& member : members) {
    if (Status named = check_subject({Subject::Kind::kClient, member}); !named) return named;
  }
  if (members.empty()) {
    groups_.erase(name);
  } else {
    groups_[name] = std::move(members);
  }
  return {};
}

void Rights::set_standard(Right right, bool may_create) {
  standard_ = right;
  may_create_ = may_create;
}

Status Rights::let_maker_write(const std::string& client, const MapId& map, Timestamp now) {
  const Subject maker{Subject::Kind::kClient, client};
  if (grants_.contains({maker, map})) return {};
  return grant({maker, map, Right::kWrite, {}, {}, kByMaking, now});
}

void Rights::close_to_unnamed() {
  set_standard(Right::kNone, false);
  std::erase_if(grants_, [](const auto& grant) { return grant.second.by == kByMaking; });
  const auto is_everyone = [](const Subject& subject) { return subject.kind == Subject::Kind::kEveryone; };
  std::erase_if(grants_, [&](const auto& grant) { return is_everyone(grant.first.first); });
  std::erase_if(creators_, [&](const auto& creator) { return is_everyone(creator.first); });
}

Status Rights::freeze(const MapId& map, std::optional<Closure> closure) {
  if (!closure) {
    frozen_.erase(map);
    return {};
  }
  if (Status said = check_closure(*closure); !said) return said;
  frozen_[map] = std::move(*closure);
  return {};
}

Status Rights::block(const std::string& client, std::optional<Closure> closure) {
  if (Status named = check_subject({Subject::Kind::kClient, client}); !named) return named;
  if (!closure) {
    blocked_.erase(client);
    return {};
  }
  if (Status said = check_closure(*closure); !said) return said;
  blocked_[client] = std::move(*closure);
  return {};
}

void Rights::forget(const MapId& map) {
  std::erase_if(grants_, [&](const auto& entry) { return entry.first.second == map; });
  frozen_.erase(map);
  proposals_in_.erase(map);
}

void Rights::welcome_proposals(const std::optional<MapId>& map, std::optional<bool> welcome) {
  if (!map) {
    proposals_ = welcome.value_or(false);
  } else if (welcome) {
    proposals_in_[*map] = *welcome;
  } else {
    proposals_in_.erase(*map);
  }
}

bool Rights::welcomes_proposals(const MapId& map) const {
  const auto said = proposals_in_.find(map);
  return said == proposals_in_.end() ? proposals_ : said->second;
}

std::string Rights::why_frozen(const MapId& map) const {
  const auto frozen = frozen_.find(map);
  return frozen == frozen_.end() ? std::string() : reason_of("the map is frozen", frozen->second);
}

std::string Rights::why_blocked(const std::string& client) const {
  const auto blocked = blocked_.find(client);
  return blocked == blocked_.end() ? std::string() : reason_of("this client is blocked", blocked->second);
}

std::vector<Membership> Rights::memberships(const std::string& client) const {
  std::map<std::string, Membership> by_group;
  for (const auto& [group, members] : groups_) {
    if (members.contains(client)) by_group[group].by_rights = true;
  }
  if (const auto keys = groups_of_keys_.find(client); keys != groups_of_keys_.end()) {
    for (const std::string& group : keys->second) by_group[group].by_keys = true;
  }
  std::vector<Membership> memberships;
  for (auto& [group, membership] : by_group) {
    membership.group = group;
    memberships.push_back(std::move(membership));
  }
  return memberships;
}

std::set<std::string> Rights::named_clients() const {
  std::set<std::string> names;
  for (const auto& [key, grant] : grants_) {
    if (grant.subject.kind == Subject::Kind::kClient) names.insert(grant.subject.name);
  }
  for (const auto& [group, members] : groups_) names.insert(members.begin(), members.end());
  for (const auto& [client, groups] : groups_of_keys_) names.insert(client);
  return names;
}

std::set<std::string> Rights::groups() const {
  std::set<std::string> names;
  for (const auto& [group, members] : groups_) names.insert(group);
  for (const auto& [client, groups] : groups_of_keys_) names.insert(groups.begin(), groups.end());
  return names;
}

/// The closest first.
std::vector<Subject> Rights::subjects_of(const std::string& client) const {
  std::vector<Subject> subjects{{Subject::Kind::kClient, client}};
  for (const Membership& member : memberships(client))
    subjects.push_back({Subject::Kind::kGroup, member.group});
  subjects.push_back({});
  return subjects;
}

/// Grants that name the client, in the order in which they are applied.
std::vector<const Grant*> Rights::grants_for(const std::string& client, const MapId& map) const {
  std::vector<const Grant*> grants;
  const std::vector<Subject> subjects = subjects_of(client);
  for (const std::optional<MapId>& object : {std::optional(map), std::optional<MapId>()}) {
    for (const Subject& subject : subjects) {
      const auto found = grants_.find({subject, object});
      if (found != grants_.end()) grants.push_back(&found->second);
    }
  }
  // Of groups, which are as close as each other, the one that grants most.
  std::stable_sort(grants.begin(), grants.end(), [](const Grant* a, const Grant* b) {
    if (a->map.has_value() != b->map.has_value()) return a->map.has_value();
    if (a->subject.kind != b->subject.kind) return a->subject.kind > b->subject.kind;
    if (a->right != b->right) return a->right > b->right;
    return !a->extent && b->extent;
  });
  return grants;
}

const Grant* Rights::deciding(const std::vector<const Grant*>& grants, Timestamp now) const {
  const auto found = std::find_if(grants.begin(), grants.end(),
                                  [&](const Grant* grant) { return !is_expired(*grant, now); });
  return found == grants.end() ? nullptr : *found;
}

Ruling Rights::rule_unless_frozen(const std::string& client, const MapId& map, Timestamp now) const {
  Ruling ruling;
  ruling.reason = why_blocked(client);
  if (!ruling.reason.empty()) return ruling;
  const auto grants = grants_for(client, map);
  if (const Grant* grant = deciding(grants, now)) {
    ruling = {grant->right, grant->extent, grant->expires, reason_of(*grant, client)};
  } else {
    ruling = {standard_, {}, {}, may_do(client, standard_) + ", as everyone at this site"};
    if (!grants.empty())
      ruling.reason += "; what was granted has expired " + to_utc(*grants.front()->expires);
  }
  return ruling;
}

Ruling Rights::rule(const std::string& client, const MapId& map, Timestamp now) const {
  Ruling ruling = rule_unless_frozen(client, map, now);
  const auto frozen = frozen_.find(map);
  if (frozen != frozen_.end() && ruling.right > Right::kRead) {
    ruling.right = Right::kRead;
    ruling.extent.reset();
    ruling.reason = reason_of("the map is frozen", frozen->second);
  }
  return ruling;
}

/// `decides`: null where the site's default holds.
std::string Rights::reason_to_create(const Subject* decides, bool may) const {
  if (decides != nullptr) return to_string(*decides) + (may ? " may make maps" : " may not make maps");
  if (may) return "everyone at this site may make maps";
  const bool is_anybody_named = std::ranges::any_of(creators_, [](const auto& rule) { return rule.second; });
  return is_anybody_named ? "at this site only those may make maps whom an operator has named"
                          : "nobody at this site may make maps";
}

Ruling Rights::rule_on_creating(const std::string& client) const {
  if (std::string why = why_blocked(client); !why.empty()) return {Right::kNone, {}, {}, std::move(why)};
  const Subject* decides = nullptr;
  bool may = may_create_;
  const std::vector<Subject> subjects = subjects_of(client);
  for (const Subject& subject : subjects) {
    const auto found = creators_.find(subject);
    if (found == creators_.end()) continue;
    const bool is_closest = decides == nullptr;
    const bool is_as_close =
        !is_closest && decides->kind == subject.kind;  // of groups, one that may is enough
    if (!is_closest && !(is_as_close && found->second)) continue;
    decides = &subject;
    may = found->second;
  }
  return {may ? Right::kWrite : Right::kNone, {}, {}, reason_to_create(decides, may)};
}

std::vector<RuleSeen> Rights::explain(const std::string& client, const MapId& map, Timestamp now) const {
  using Part = RuleSeen::Part;
  std::vector<RuleSeen> seen;
  bool is_decided = false;
  const auto see = [&](std::string rule, bool expired) {
    const Part part = expired ? Part::kExpired : is_decided ? Part::kOutweighed : Part::kDecides;
    is_decided = is_decided || part == Part::kDecides;
    seen.push_back({std::move(rule), part});
  };
  if (const auto blocked = blocked_.find(client); blocked != blocked_.end())
    see(reason_of("client " + client + " is blocked", blocked->second), false);
  const auto frozen = frozen_.find(map);
  if (frozen != frozen_.end() && rule_unless_frozen(client, map, now).right > Right::kRead)
    see(reason_of("the map is frozen", frozen->second), false);
  for (const Grant* grant : grants_for(client, map)) {
    see(to_string(grant->subject) + (grant->map ? ", this map: " : ", all maps: ") + words_of(*grant),
        is_expired(*grant, now));
  }
  see("everyone, by default: " + std::string(to_string(standard_)), false);
  return seen;
}

std::optional<Timestamp> Rights::next_expiry(Timestamp now) const {
  std::optional<Timestamp> next;
  for (const auto& [key, grant] : grants_) {
    if (!grant.expires || *grant.expires <= now) continue;
    if (!next || *grant.expires < *next) next = grant.expires;
  }
  return next;
}

Rights::Table Rights::table() const {
  Table table{standard_, may_create_, {}, creators_, groups_, frozen_, blocked_, proposals_, proposals_in_};
  for (const auto& [key, grant] : grants_) table.grants.push_back(grant);
  return table;
}

Result<Rights> Rights::of(const Table& table) {
  Rights rights(table.standard, table.may_create);
  for (const Grant& grant : table.grants) {
    if (Status taken = rights.grant(grant); !taken) return tl::unexpected(taken.error());
  }
  for (const auto& [subject, may] : table.creators) {
    if (Status taken = rights.let_create(subject, may); !taken) return tl::unexpected(taken.error());
  }
  for (const auto& [name, members] : table.groups) {
    if (Status taken = rights.put_group(name, members); !taken) return tl::unexpected(taken.error());
  }
  for (const auto& [map, closure] : table.frozen) {
    if (Status taken = rights.freeze(map, closure); !taken) return tl::unexpected(taken.error());
  }
  for (const auto& [client, closure] : table.blocked) {
    if (Status taken = rights.block(client, closure); !taken) return tl::unexpected(taken.error());
  }
  rights.proposals_ = table.proposals;
  rights.proposals_in_ = table.proposals_in;
  return rights;
}

}  // namespace cairn
