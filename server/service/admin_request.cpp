// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_request.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "server/service/rights_requests.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr int kMostNested = 8;  ///< what is written deeper would take the stack
constexpr size_t kLoggedBytes = 200;

std::string text_in(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_string() ? it->get<std::string>() : std::string();
}

uint64_t number_in(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_number_unsigned() ? it->get<uint64_t>() : 0;
}

bool truth_in(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_boolean() && it->get<bool>();
}

using What = decltype(AskedOfServer::what);

What of_map(const json& request, decltype(asked::OfMap::what) what) {
  return asked::OfMap{text_in(request, "map"), std::move(what)};
}

template <typename Ask>
What fit_or_not(Result<Ask> ask) {
  if (!ask) return asked::Unfit{std::move(ask.error())};
  return std::move(*ask);
}

struct AdminVerb {
  std::string_view name;
  OperatorAct act;
  What (*read)(const json& request);
  bool is_piece = false;
};

using enum OperatorAct;

constexpr std::array kOfServer{
    AdminVerb{"status", kSee, [](const json&) -> What { return asked::Status{}; }},
    AdminVerb{"rigs", kSee, [](const json&) -> What { return asked::Rigs{}; }},
    AdminVerb{"clients", kSee, [](const json&) -> What { return asked::Clients{}; }},
    AdminVerb{"client-kick", kChange,
              [](const json& r) -> What { return asked::KickClient{text_in(r, "client")}; }},
    AdminVerb{"maps", kSee,
              [](const json& r) -> What {
                return asked::Maps{text_in(r, "after"), number_in(r, "deleted_from"),
                                   number_in(r, "damaged_from"), number_in(r, "unloaded_from")};
              }},
    AdminVerb{"rights", kSee, [](const json&) -> What { return asked::Rights{}; }},
    AdminVerb{"rights-explain", kSee, [](const json& r) { return fit_or_not(read_explain_rights(r)); }},
    AdminVerb{"audit", kSee, [](const json& r) { return fit_or_not(read_audit(r)); }},
    AdminVerb{"undelete", kChange, [](const json& r) -> What { return asked::Undelete{text_in(r, "map")}; }},
    AdminVerb{"purge", kChange, [](const json& r) -> What { return asked::Purge{text_in(r, "map")}; }},
    AdminVerb{"import", kTransfer, [](const json& r) -> What { return asked::Import{text_in(r, "token")}; }},
    AdminVerb{"import-begin", kTransfer,
              [](const json& r) -> What { return asked::ImportBegin{text_in(r, "token")}; }},
    AdminVerb{"import-write", kTransfer,
              [](const json& r) -> What {
                return asked::ImportWrite{text_in(r, "token"), number_in(r, "offset")};
              },
              true},
    AdminVerb{"export-read", kTransfer,
              [](const json& r) -> What {
                return asked::ExportRead{text_in(r, "token"), number_in(r, "offset")};
              },
              true},
    AdminVerb{"backup", kTransfer, [](const json& r) -> What { return asked::Backup{text_in(r, "after")}; }},
    AdminVerb{"backup-part", kTransfer,
              [](const json& r) -> What { return asked::BackupPart{text_in(r, "part")}; }, true},
    AdminVerb{"verify", kExamine, [](const json& r) -> What { return asked::Verify{text_in(r, "after")}; }},
    AdminVerb{"verify-part", kExamine,
              [](const json& r) -> What { return asked::VerifyPart{text_in(r, "part")}; }, true},
    AdminVerb{"proposals", kSee,
              [](const json& r) -> What {
                return asked::Proposals{text_in(r, "map"), text_in(r, "client"), text_in(r, "after_map"),
                                        number_in(r, "after")};
              }},
    AdminVerb{"proposal-show", kTransfer,
              [](const json& r) -> What { return asked::ShowProposal{text_in(r, "proposal")}; }},
    AdminVerb{"proposal-picture", kTransfer,
              [](const json& r) -> What {
                return asked::ProposalImage{text_in(r, "proposal"), number_in(r, "offset")};
              },
              true},
    AdminVerb{"proposal-accept", kChange,
              [](const json& r) -> What { return asked::AcceptProposal{text_in(r, "proposal")}; }},
    AdminVerb{"proposal-drop", kChange,
              [](const json& r) -> What { return asked::DropProposal{text_in(r, "proposal")}; }}};

constexpr std::array kOfMap{
    AdminVerb{"show", kSee, [](const json& r) { return of_map(r, asked::Show{}); }},
    AdminVerb{"rename", kChange, [](const json& r) { return of_map(r, asked::Rename{text_in(r, "name")}); }},
    AdminVerb{"delete", kChange,
              [](const json& r) { return of_map(r, asked::Delete{truth_in(r, "for_good")}); }},
    AdminVerb{"export", kTransfer, [](const json& r) { return of_map(r, asked::Export{}); }},
    AdminVerb{"tag", kChange, [](const json& r) { return of_map(r, asked::Tag{text_in(r, "tag")}); }},
    AdminVerb{"untag", kChange, [](const json& r) { return of_map(r, asked::Untag{text_in(r, "tag")}); }},
    AdminVerb{"tags", kSee, [](const json& r) { return of_map(r, asked::Tags{number_in(r, "after")}); }},
    AdminVerb{"roll-back", kChange,
              [](const json& r) { return of_map(r, asked::RollBack{text_in(r, "tag")}); }},
    AdminVerb{"copy", kChange, [](const json& r) { return of_map(r, asked::Copy{text_in(r, "name")}); }},
    AdminVerb{"contributors", kSee,
              [](const json& r) { return of_map(r, asked::Contributors{text_in(r, "after")}); }},
    AdminVerb{"drop-contributor", kChange,
              [](const json& r) { return of_map(r, asked::DropContributor{text_in(r, "client")}); }},
    AdminVerb{"labels", kSee,
              [](const json& r) { return of_map(r, asked::Labels{LabelId{number_in(r, "label")}}); }},
    AdminVerb{"label-rename", kChange,
              [](const json& r) {
                return of_map(r, asked::RenameLabel{LabelId{number_in(r, "label")}, text_in(r, "text")});
              }},
    AdminVerb{"label-remove", kChange,
              [](const json& r) { return of_map(r, asked::RemoveLabel{LabelId{number_in(r, "label")}}); }}};

template <typename Verbs>
const AdminVerb* find_admin_verb(const Verbs& verbs, std::string_view name) {
  const auto found = std::ranges::find(verbs, name, &AdminVerb::name);
  return found == verbs.end() ? nullptr : &*found;
}

/// The object that a request is about, for the audit log.
std::string object_of(const json& request) {
  std::string object;
  for (const char* part : {"map", "tag", "name", "client", "proposal"}) {
    const auto named = request.find(part);
    if (named == request.end() || !named->is_string()) continue;
    const std::string name = named->get<std::string>();
    if (name.empty() && part != std::string_view("map")) continue;
    object += (object.empty() ? "" : ", ") + std::string(part) + " " + name;
  }
  const auto label = request.find("label");
  if (label != request.end() && label->is_number_unsigned())
    object += ", label " + std::to_string(label->get<uint64_t>());
  const auto text = request.find("text");
  if (text != request.end() && text->is_string()) object += ", text " + text->get<std::string>();
  return object;
}

/// Parses a request. The result is `null` where the text is no JSON object, or is nested deeper than
/// kMostNested.
json parse_request(const std::string& text) {
  bool is_deep = false;
  const auto keep = [&is_deep](int depth, json::parse_event_t, json&) {
    is_deep = is_deep || depth > kMostNested;
    return depth <= kMostNested;
  };
  json request = json::parse(text, keep, false);
  return is_deep || !request.is_object() ? json() : request;
}

}  // namespace

Result<AskedOfServer> read_admin_request(const std::string& text) {
  const json request = parse_request(text);
  if (!request.is_object()) return fail(ErrorCode::kUsage, "a request that is no JSON object");
  AskedOfServer asks;
  asks.verb = text_in(request, "verb");
  if (asks.verb.empty()) return fail(ErrorCode::kUsage, "a request without 'verb', a text");
  asks.object = object_of(request);
  asks.text = cut_text(json_text(request), kLoggedBytes);
  if (changes_rights(asks.verb)) {
    // Who looks after maps may close one to everybody; whom it is open to is for others to say.
    const bool is_about_map = asks.verb == "map-freeze" || asks.verb == "map-unfreeze";
    asks.act = is_about_map ? OperatorAct::kChange : OperatorAct::kGovern;
    asks.what = fit_or_not(read_change_rights(asks.verb, request));
    return asks;
  }
  const AdminVerb* verb = find_admin_verb(kOfServer, asks.verb);
  if (verb == nullptr) verb = find_admin_verb(kOfMap, asks.verb);
  if (verb == nullptr) return asks;
  asks.act = verb->act;
  asks.is_piece = verb->is_piece;
  asks.what = verb->read(request);
  return asks;
}

}  // namespace cairn
