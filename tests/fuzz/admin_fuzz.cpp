// SPDX-License-Identifier: Apache-2.0
//
// What operators ask a server for, about rights above all, and what a server answers to cairnctl. The first
// byte says which.
#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/base/utf8.h"
#include "server/access/rights_file.h"
#include "server/admin/listing.h"
#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/rights_verbs.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

using nlohmann::json;

constexpr Timestamp kNow{1'800'000'000'000'000'000};

std::optional<NamedMap> find_map(const std::string& name) {
  if (name != "desk") return std::nullopt;
  NamedMap desk{{}, name, {{-1, -1, -1}, {1, 1, 1}}};
  desk.id.bytes.fill(7);
  return desk;
}

const Rights& rights() {
  static const Rights made = [] {
    Rights some(Right::kRead, true);
    demand(some.put_group("crew", {"ann", "bob"}).has_value(), "there is a group");
    demand(
        some.grant(
                {{Subject::Kind::kGroup, "crew"}, find_map("desk")->id, Right::kWrite, {}, {}, "ops", kNow})
            .has_value(),
        "there is a grant");
    return some;
  }();
  return made;
}

void ask(Bytes bytes) {
  const auto asks = read_admin_request(std::string(text_of(bytes)));
  if (!asks) return demand(!asks.error().message.empty(), "a refusal has a reason");
  demand(!asks->is_piece || asks->act != OperatorAct::kSee, "what goes unrecorded in pieces is no mere look");
  if (const auto* unfit = std::get_if<asked::Unfit>(&asks->what))
    demand(unfit->why.code == ErrorCode::kUsage && !unfit->why.message.empty(), "what is unfit is told why");
  if (const auto* ask = std::get_if<asked::ChangeRights>(&asks->what)) {
    const auto change = change_rights(rights(), *ask, "ann", find_map, kNow);
    if (!change) return demand(!change.error().message.empty(), "a refusal has a reason");
    const auto again = read_rights(to_text(change->rights));
    demand(again && again->table() == change->rights.table(), "rights that are changed are kept as they are");
    demand(!fault_of_text(change->entry.object), "what the audit log says can be shown");
    demand(!fault_of_text(note_on_names(rights(), *ask, {{"phone-1"}, true})),
           "a note on names can be shown");
    const told::Rights shown{change->rights.table(), {{find_map("desk")->id, "desk"}}, kNow, {}, true};
    demand(reply_of(shown).result == 0, "rights can be shown");
  }
  if (const auto* ask = std::get_if<asked::ExplainRights>(&asks->what)) {
    const auto explained = explain_rights(rights(), *ask, find_map, {{"phone-1"}, true}, kNow);
    demand(!explained || reply_of(*explained).result == 0, "an explanation can be shown");
  }
  if (const auto* ask = std::get_if<asked::Audit>(&asks->what))
    demand(ask->query.limit <= 500, "a page of the audit log is short");
}

/// Printed to nowhere. What is not as a server says it may end in an exception of the JSON library, which
/// cairnctl turns into a word about the server.
void answer(Bytes bytes) {
  const json content = json::parse(text_of(bytes), nullptr, false);
  if (!content.is_object()) return;
  for (const auto print :
       {print_map, print_whole_map, print_deleted, print_damaged, print_unloaded, print_rig, print_label}) {
    try {
      print(content);
    } catch (const json::exception&) {
      continue;
    }
  }
}

}  // namespace

void decode(Bytes bytes) {
  static const bool is_quiet = std::freopen("/dev/null", "w", stdout) != nullptr;
  demand(is_quiet, "there is /dev/null");
  if (bytes.empty()) return;
  bytes[0] % 2 == 0 ? ask(bytes.subspan(1)) : answer(bytes.subspan(1));
}

std::vector<Input> seeds() {
  constexpr const char* kRequests[] = {
      R"({"verb": "maps", "after": "00ff", "deleted_from": 3, "damaged_from": 0, "unloaded_from": 1})",
      R"({"verb": "delete", "map": "desk", "for_good": true})",
      R"({"verb": "rights-grant", "to": "group crew", "map": "desk", "right": "add", "within": {"box": [[0, 0, 0],)"
      R"( [1, 2.5, 1e2]]}, "until": "2199-12-31"})",
      R"({"verb": "rights-grant", "to": "phone-1", "map": "desk", "right": "write", "within": {"margin": 0.5}})",
      R"({"verb": "rights-grant", "to": "everyone", "map": "desk", "right": "write", "within": {"center": [1, 2,)"
      R"( 3], "radius": 4}})",
      R"({"verb": "rights-revoke", "to": "group crew", "map": "desk"})",
      R"({"verb": "rights-default", "right": "none", "create": false})",
      R"({"verb": "rights-create", "to": "phone-1", "may": true})",
      R"({"verb": "rights-group", "group": "crew", "members": ["ann", "eve"]})",
      R"({"verb": "map-extent", "to": "group crew", "map": "desk", "within": {"margin": 0.5}})",
      R"({"verb": "map-freeze", "map": "desk", "why": "an exhibition"})",
      R"({"verb": "client-block", "client": "eve", "why": "lost"})",
      R"({"verb": "rights-explain", "client": "ann", "map": "desk"})",
      R"({"verb": "audit", "who": "ann", "from": "2026-12-01T12:00:00Z", "before": 12, "limit": 50})"};
  constexpr const char* kAnswers[] = {
      R"({"name": "desk", "id": "00ff", "keyframes": 12, "points": 345, "memory_bytes": 1e7, "at_rest": true,)"
      R"( "overlaps": [{"map": "bench", "keyframes": 3, "its_keyframes": 4}], "epoch": 3, "revision": 9,)"
      R"( "cameras": [{"model": "FOV", "width": 640, "height": 480, "focal_px": 525.0, "keyframes": 3}]})",
      R"({"rig": "shoulder", "mode": "fixate", "commander": "ann", "stopped": true, "last_order": {"mode":)"
      R"( "home", "by": "ann", "refusal": "no"}, "trouble": "silent"})",
      R"({"map": "desk", "id": 3, "text": "kettle", "author": "ann", "time": 1800000000000000000, "position":)"
      R"( [1, 2, 3], "kind": "model", "file": "x", "reasons": ["cut"], "served": true, "damaged": "cut"})"};
  std::vector<Input> all;
  for (const char* request : kRequests) {
    demand(read_admin_request(request).has_value(), request);
    all.push_back(input_of(0, request));
  }
  for (const char* said : kAnswers) {
    demand(json::parse(said, nullptr, false).is_object(), said);
    all.push_back(input_of(1, said));
  }
  return all;
}

}  // namespace cairn::fuzz
