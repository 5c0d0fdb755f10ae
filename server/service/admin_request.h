// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <variant>

#include "common/map/extent.h"
#include "common/map/ids.h"
#include "server/access/access_policy.h"
#include "server/store/site_file.h"

/// What operators ask, as it comes from the wire (idl/README.md, AdminRequest): any text, and what it says as
/// values. Behind this nothing of a request is JSON. Pure.
namespace cairn {

namespace asked {

// Of the server.
struct Status {};
struct Rigs {};
struct Clients {};
struct KickClient {
  std::string client;
};
/// A page of maps begins beyond an id, and at numbers of the lists behind them.
struct Maps {
  std::string after;
  size_t deleted_from = 0;
  size_t damaged_from = 0;
  size_t unloaded_from = 0;
};

// Of rights and of what was done.
struct Rights {};
struct ExplainRights {
  std::string client;
  std::string map;
};
struct Audit {
  AuditQuery query;
};
// Whom a right is for, what it is and until when: words that rights_verbs.h takes. `map`: "all", or one.
struct Margin {
  double around = 0;  ///< the map's present bounds
};
using Within = std::variant<Box, Sphere, Margin>;
inline constexpr const char* kWhatWithinHas =
    "'within' has a box, a center and a radius, or a margin around the map's bounds";
struct GrantRight {
  std::string to;
  std::string map;
  std::string right;
  std::optional<Within> within;
  std::string until;  ///< empty: for ever
};
/// The right that is there stays, within an extent from now on, or, without one, everywhere.
struct LimitGrowth {
  std::string to;
  std::string map;
  std::optional<Within> within;
};
struct RevokeRight {
  std::string to;
  std::string map;
};
struct SetStandard {
  std::string right;           ///< empty: as it is
  std::optional<bool> create;  ///< likewise
};
struct LetCreate {
  std::string to;
  std::optional<bool> may;
};
struct PutGroup {
  std::string group;
  std::set<std::string> members;
};
struct FreezeMap {
  std::string map;
  std::string why;
};
struct UnfreezeMap {
  std::string map;
};
struct BlockClient {
  std::string client;
  std::string why;
};
struct UnblockClient {
  std::string client;
};
struct WelcomeProposals {
  std::string map;
  std::optional<bool> welcome;
};
struct ChangeRights {
  std::string verb;
  std::variant<GrantRight, LimitGrowth, RevokeRight, SetStandard, LetCreate, PutGroup, FreezeMap, UnfreezeMap,
               BlockClient, UnblockClient, WelcomeProposals>
      what;
};

// Of maps that have been deleted, and of archives.
struct Undelete {
  std::string map;
};
struct Purge {
  std::string map;
};
struct Import {
  std::string token;
};
struct ImportBegin {
  std::string token;
};
/// A piece of an archive, whose data come beside the text.
struct ImportWrite {
  std::string token;
  uint64_t offset = 0;
};
struct ExportRead {
  std::string token;
  uint64_t offset = 0;
};

// Of the store. `after`: the page begins beyond it.
struct Backup {
  std::string after;
};
struct BackupPart {
  std::string part;
};
struct Verify {
  std::string after;
};
struct VerifyPart {
  std::string part;
};

// Of proposals.
struct Proposals {
  std::string map;     ///< empty: of all maps
  std::string client;  ///< empty: of all clients
  std::string after_map;
  uint64_t after = 0;
};
struct ShowProposal {
  std::string proposal;
};
struct ProposalImage {
  std::string proposal;
  uint64_t offset = 0;
};
struct AcceptProposal {
  std::string proposal;
};
struct DropProposal {
  std::string proposal;
};

// Of a map that is served.
struct Show {};
struct Rename {
  std::string name;
};
struct Delete {
  bool for_good = false;
};
struct Export {};
struct Tag {
  std::string tag;
};
struct Untag {
  std::string tag;
};
struct Tags {
  uint64_t after = 0;
};
struct RollBack {
  std::string tag;
};
struct Copy {
  std::string name;
};
struct Contributors {
  std::string after;
};
struct DropContributor {
  std::string client;
};
struct Labels {
  LabelId after;
};
struct RenameLabel {
  LabelId label;
  std::string text;
};
struct RemoveLabel {
  LabelId label;
};
using OfVersions = std::variant<Tag, Untag, Tags, RollBack, Copy, Contributors, DropContributor>;
struct OfMap {
  std::string map;  ///< its name or id
  std::variant<Show, Rename, Delete, Export, OfVersions, Labels, RenameLabel, RemoveLabel> what;
};

struct Unknown {};
/// A request whose verb is known, but whose members are not those that the verb takes.
struct Unfit {
  Error why;
};

}  // namespace asked

struct AskedOfServer {
  std::string verb;
  OperatorAct act = OperatorAct::kChange;
  bool is_piece = false;  ///< of an archive or a store: asked for in hundreds, and what began it is on record
  std::string object;     ///< what it is about, for the audit log
  std::string text;       ///< all of it on one line, cut short, for the log
  std::variant<asked::Unknown, asked::Unfit, asked::Status, asked::Rigs, asked::Clients, asked::KickClient,
               asked::Maps, asked::Rights, asked::ExplainRights, asked::ChangeRights, asked::Audit,
               asked::Undelete, asked::Purge, asked::Import, asked::ImportBegin, asked::ImportWrite,
               asked::ExportRead, asked::Backup, asked::BackupPart, asked::Verify, asked::VerifyPart,
               asked::Proposals, asked::ShowProposal, asked::ProposalImage, asked::AcceptProposal,
               asked::DropProposal, asked::OfMap>
      what;

  [[nodiscard]] bool is_audited() const { return act != OperatorAct::kSee && !is_piece; }
};

/// What is asked by it: members that are missing, or of another kind than they must be, are empty, zero,
/// false; of what is asked about rights and of the audit log they are Unfit. Error kUsage: it is no request.
[[nodiscard]] Result<AskedOfServer> read_admin_request(const std::string& text);

}  // namespace cairn
