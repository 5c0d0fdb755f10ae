// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/map/extent.h"
#include "common/map/ids.h"

namespace cairn {

/// What a client may do with a map; each includes those before it (DESIGN 8).
enum class Right : uint8_t {
  kNone,    ///< does not learn that the map is there
  kRead,    ///< sees it listed, finds itself in it, receives it
  kAdd,     ///< adds keyframes and labels; what others put there stays as it is
  kWrite,   ///< changes and removes labels, too
  kManage,  ///< no request of a client needs it yet
};

/// The word of the command line and of the file: "none", "read", "add", "write", "manage".
[[nodiscard]] std::string_view to_string(Right right);
/// Its inverse; error kUsage with the words that there are.
[[nodiscard]] Result<Right> parse_right(std::string_view word);

/// Whom a grant is for. Ordered by how closely it names a client.
struct Subject {
  enum class Kind : uint8_t { kEveryone, kGroup, kClient };
  Kind kind = Kind::kEveryone;
  std::string name;  ///< of the group or client; empty for everyone
  auto operator<=>(const Subject&) const = default;
};

/// "everyone", "group crew", "client phone-1".
[[nodiscard]] std::string to_string(const Subject& subject);
/// Its inverse; a lone name is a client's. Error kUsage.
[[nodiscard]] Result<Subject> parse_subject(std::string_view words);

/// What an operator has granted to somebody, of one map or of all.
struct Grant {
  Subject subject;
  std::optional<MapId> map;  ///< nothing: of every map that no grant names for this client
  Right right = Right::kNone;
  std::optional<Extent> extent;      ///< in which the map may grow by it; of kAdd and kWrite only
  std::optional<Timestamp> expires;  ///< from then on it is as if it were not there
  std::string by;                    ///< the operator who granted it
  Timestamp since;
  bool operator==(const Grant&) const = default;
};

/// Something that somebody has closed: a map that takes nothing from anybody, a client that is kept out.
struct Closure {
  std::string by;
  Timestamp since;
  std::string why;  ///< for a person; may be empty
  bool operator==(const Closure&) const = default;
};

/// What a client may do with a map, and what says so.
struct Ruling {
  Right right = Right::kNone;
  std::optional<Extent> extent;      ///< in which it may let the map grow; nothing: everywhere
  std::optional<Timestamp> expires;  ///< when the right may be another
  /// For the client's user: "phone-1 may only read here, as granted to group visitors by ann".
  std::string reason;
  bool operator==(const Ruling&) const = default;
};

/// One of the rules that bear on a ruling (explain()).
struct RuleSeen {
  enum class Part : uint8_t { kDecides, kExpired, kOutweighed };
  std::string rule;  ///< for a person: "client phone-1, this map: write until 2026-12-01 12:00:00"
  Part part = Part::kOutweighed;
};

/// Groups that each client belongs to, by the client's name.
using GroupsOfClients = std::map<std::string, std::set<std::string>>;

/// That a client belongs to a group, and what says so.
struct Membership {
  std::string group;
  bool by_rights = false;  ///< put_group()
  bool by_keys = false;    ///< set_groups_of_keys()
  bool operator==(const Membership&) const = default;
};

/// Who may do what with which map: a value, without clock or disk. Of the grants that name a client and have
/// not expired, one for the map is before one for all maps, and then the one that names it most closely:
/// client, group (of several, the one that grants most), everyone. Where there is none, the site's default
/// holds. A blocked client may do nothing; in a frozen map nobody more than read.
class Rights {
 public:
  /// `standard`: of who is not named by any grant; `may_create`: whether such a one may make maps.
  Rights(Right standard, bool may_create) : standard_(standard), may_create_(may_create) {}

  /// Adds a grant, in place of the one with the same subject and map, if there is one. Error kUsage: names
  /// that cannot be, or an extent that cannot be, of all maps, or of a right that lets nothing grow.
  [[nodiscard]] Status grant(Grant grant);
  /// Removes a grant. Error kNotFound: there is no such grant.
  [[nodiscard]] Status revoke(const Subject& subject, const std::optional<MapId>& map);
  /// Sets whether a subject may make maps. `may` nothing: its other grants and the site's default say so.
  [[nodiscard]] Status let_create(const Subject& subject, std::optional<bool> may);
  /// Sets the members of a group; an empty set removes it.
  [[nodiscard]] Status put_group(const std::string& name, std::set<std::string> members);
  /// Sets the groups that the keys of clients name, beside those of put_group(). They are no part of table():
  /// the register of the keys says so at each start.
  void set_groups_of_keys(GroupsOfClients groups) { groups_of_keys_ = std::move(groups); }
  void set_standard(Right right, bool may_create);
  /// Lets the maker of a map write in it, unless a grant to this client for this map says something else. The
  /// grant is by the server, and revocable as any other.
  [[nodiscard]] Status let_maker_write(const std::string& client, const MapId& map, Timestamp now);
  /// From now on a client that is not named, as a client or by a group, may do nothing: neither by default
  /// nor by what everyone was granted, nor by having made a map when nobody had to prove who he was.
  void close_to_unnamed();
  /// Freezes a map, or with no `closure` lets it take keyframes again. Error kUsage: words that a person
  /// cannot read in one line.
  [[nodiscard]] Status freeze(const MapId& map, std::optional<Closure> closure);
  /// Blocks a client, or with no `closure` lets it in again. Error kUsage: no client can have that name; as
  /// of freeze().
  [[nodiscard]] Status block(const std::string& client, std::optional<Closure> closure);
  /// Sets whether keyframes of those who may not add them are kept aside as proposals: in a map or, without
  /// one, in all maps of which nothing else is said. `welcome` nothing: in the map as in all others; in all,
  /// no.
  void welcome_proposals(const std::optional<MapId>& map, std::optional<bool> welcome);
  /// Forgets a map that is gone for good: its grants go with it.
  void forget(const MapId& map);

  [[nodiscard]] Ruling rule(const std::string& client, const MapId& map, Timestamp now) const;
  /// Whether the client may make maps: `right` of the ruling is kWrite or kNone.
  [[nodiscard]] Ruling rule_on_creating(const std::string& client) const;
  [[nodiscard]] bool welcomes_proposals(const MapId& map) const;
  /// Why the map is frozen, for a person; empty: it is not.
  [[nodiscard]] std::string why_frozen(const MapId& map) const;
  /// Why the client is blocked, for a person; empty: it is not.
  [[nodiscard]] std::string why_blocked(const std::string& client) const;
  /// All rules that bear on the ruling of rule(), in the order of precedence.
  [[nodiscard]] std::vector<RuleSeen> explain(const std::string& client, const MapId& map,
                                              Timestamp now) const;
  /// Clients that a grant or a group names, or that have keys.
  [[nodiscard]] std::set<std::string> named_clients() const;
  /// The groups of a client and what says so, ordered by group.
  [[nodiscard]] std::vector<Membership> memberships(const std::string& client) const;
  /// All groups that have members, by rights or by keys.
  [[nodiscard]] std::set<std::string> groups() const;
  /// When a ruling changes next by itself, after `now`.
  [[nodiscard]] std::optional<Timestamp> next_expiry(Timestamp now) const;

  /// All rules and grants, to be kept and shown.
  struct Table {
    Right standard = Right::kNone;
    bool may_create = false;
    std::vector<Grant> grants;
    std::map<Subject, bool> creators;
    std::map<std::string, std::set<std::string>> groups;
    std::map<MapId, Closure> frozen;
    std::map<std::string, Closure> blocked;
    bool proposals = false;              ///< are welcome in maps of which nothing is said
    std::map<MapId, bool> proposals_in;  ///< and in these
    bool operator==(const Table&) const = default;
  };
  [[nodiscard]] Table table() const;
  /// Error kUsage: as of those that change it.
  [[nodiscard]] static Result<Rights> of(const Table& table);

 private:
  using Key = std::pair<Subject, std::optional<MapId>>;
  [[nodiscard]] std::vector<const Grant*> grants_for(const std::string& client, const MapId& map) const;
  [[nodiscard]] std::vector<Subject> subjects_of(const std::string& client) const;
  [[nodiscard]] Ruling rule_unless_frozen(const std::string& client, const MapId& map, Timestamp now) const;
  [[nodiscard]] std::string reason_to_create(const Subject* decides, bool may) const;
  [[nodiscard]] const Grant* deciding(const std::vector<const Grant*>& grants, Timestamp now) const;

  Right standard_;
  bool may_create_;
  std::map<Key, Grant> grants_;
  std::map<Subject, bool> creators_;
  std::map<std::string, std::set<std::string>> groups_;
  GroupsOfClients groups_of_keys_;
  std::map<MapId, Closure> frozen_;
  std::map<std::string, Closure> blocked_;
  bool proposals_ = false;
  std::map<MapId, bool> proposals_in_;
};

}  // namespace cairn
