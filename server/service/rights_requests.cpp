// SPDX-License-Identifier: Apache-2.0
#include "server/service/rights_requests.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string_view>

#include "common/base/utc.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr size_t kMostEntries = 500;  ///< of an audit page

/// An error inside, turned into a Result at the border of this file.
struct UnfitRequest {
  std::string why;
};

[[noreturn]] void call_unfit(std::string why) {
  throw UnfitRequest{std::move(why)};
}

/// Empty where there is none.
std::string text_of(const json& request, const char* key) {
  const auto it = request.find(key);
  if (it == request.end()) return {};
  if (!it->is_string()) call_unfit("'" + std::string(key) + "' is no text");
  return it->get<std::string>();
}

std::string needed(const json& request, const char* key) {
  std::string text = text_of(request, key);
  if (text.empty()) call_unfit("'" + std::string(key) + "' is missing");
  return text;
}

std::optional<bool> truth_of(const json& request, const char* key) {
  const auto it = request.find(key);
  if (it == request.end() || it->is_null()) return std::nullopt;
  if (!it->is_boolean()) call_unfit("'" + std::string(key) + "' is neither true nor false");
  return it->get<bool>();
}

double number_of(const json& value, const char* what) {
  if (!value.is_number()) call_unfit(std::string(what) + " is no number");
  return value.get<double>();
}

Eigen::Vector3d place_of(const json& value) {
  if (!value.is_array() || value.size() != 3) call_unfit("a place has three numbers");
  return {number_of(value[0], "x"), number_of(value[1], "y"), number_of(value[2], "z")};
}

std::optional<Timestamp> time_of(const json& request, const char* key) {
  const std::string words = text_of(request, key);
  if (words.empty()) return std::nullopt;
  const Result<Timestamp> time = parse_utc(words);
  if (!time) call_unfit(time.error().message);
  return *time;
}

asked::Within within_of(const json& within) {
  if (!within.is_object()) call_unfit("'within' is no extent");
  if (const auto box = within.find("box"); box != within.end()) {
    if (!box->is_array() || box->size() != 2) call_unfit("a box has two corners");
    return Box{place_of((*box)[0]), place_of((*box)[1])};
  }
  if (const auto center = within.find("center"); center != within.end())
    return Sphere{place_of(*center), number_of(within.value("radius", json()), "the radius")};
  if (const auto margin = within.find("margin"); margin != within.end()) {
    const double room = number_of(*margin, "the margin");
    if (!(room >= 0)) call_unfit("the margin is negative");
    return asked::Margin{room};
  }
  call_unfit(asked::kWhatWithinHas);
}

using Change = decltype(asked::ChangeRights::what);

Change read_grant(const json& request) {
  asked::GrantRight grant;
  grant.map = needed(request, "map");
  grant.to = needed(request, "to");
  grant.right = needed(request, "right");
  if (const auto within = request.find("within"); within != request.end()) grant.within = within_of(*within);
  grant.until = text_of(request, "until");
  return grant;
}

Change read_limit(const json& request) {
  asked::LimitGrowth limit;
  limit.map = needed(request, "map");
  limit.to = needed(request, "to");
  if (const auto within = request.find("within"); within != request.end()) limit.within = within_of(*within);
  return limit;
}

Change read_group(const json& request) {
  const auto list = request.find("members");
  if (list == request.end() || !list->is_array()) call_unfit("'members' is no list of names");
  asked::PutGroup put;
  for (const json& member : *list) {
    if (!member.is_string()) call_unfit("a member is a name");
    put.members.insert(member.get<std::string>());
  }
  put.group = needed(request, "group");
  return put;
}

struct RightsVerb {
  std::string_view name;
  Change (*read)(const json& request);
};
constexpr std::array kRightsVerbs{
    RightsVerb{"rights-grant", read_grant},
    RightsVerb{"map-extent", read_limit},
    RightsVerb{"rights-revoke",
               [](const json& r) -> Change {
                 std::string map = needed(r, "map");
                 return asked::RevokeRight{needed(r, "to"), std::move(map)};
               }},
    RightsVerb{"rights-default",
               [](const json& r) -> Change {
                 return asked::SetStandard{text_of(r, "right"), truth_of(r, "create")};
               }},
    RightsVerb{"rights-create",
               [](const json& r) -> Change {
                 return asked::LetCreate{needed(r, "to"), truth_of(r, "may")};
               }},
    RightsVerb{"rights-group", read_group},
    RightsVerb{"map-freeze",
               [](const json& r) -> Change {
                 return asked::FreezeMap{needed(r, "map"), text_of(r, "why")};
               }},
    RightsVerb{"map-unfreeze", [](const json& r) -> Change { return asked::UnfreezeMap{needed(r, "map")}; }},
    RightsVerb{"client-block",
               [](const json& r) -> Change {
                 return asked::BlockClient{needed(r, "client"), text_of(r, "why")};
               }},
    RightsVerb{"client-unblock",
               [](const json& r) -> Change { return asked::UnblockClient{needed(r, "client")}; }},
    RightsVerb{"proposals-welcome", [](const json& r) -> Change {
                 return asked::WelcomeProposals{needed(r, "map"), truth_of(r, "welcome")};
               }}};

const RightsVerb* find_rights_verb(std::string_view name) {
  const auto found = std::ranges::find(kRightsVerbs, name, &RightsVerb::name);
  return found == kRightsVerbs.end() ? nullptr : &*found;
}

template <typename Read>
auto fit(const Read& read) -> Result<decltype(read())> {
  try {
    return read();
  } catch (const UnfitRequest& unfit) {
    return fail(ErrorCode::kUsage, unfit.why);
  }
}

}  // namespace

bool changes_rights(const std::string& verb) {
  return find_rights_verb(verb) != nullptr;
}

Result<asked::ChangeRights> read_change_rights(const std::string& verb, const json& request) {
  return fit([&] { return asked::ChangeRights{verb, find_rights_verb(verb)->read(request)}; });
}

Result<asked::ExplainRights> read_explain_rights(const json& request) {
  return fit([&] {
    std::string map = needed(request, "map");
    return asked::ExplainRights{needed(request, "client"), std::move(map)};
  });
}

Result<asked::Audit> read_audit(const json& request) {
  return fit([&] {
    AuditQuery query{
        text_of(request, "who"), text_of(request, "action"), text_of(request, "object"), {}, {}, {}};
    query.from = time_of(request, "from");
    query.until = time_of(request, "until");
    const auto before = request.find("before");
    if (before != request.end() && before->is_number_integer()) query.before_number = before->get<int64_t>();
    const auto limit = request.find("limit");
    if (limit != request.end() && limit->is_number_unsigned()) query.limit = limit->get<size_t>();
    query.limit = std::clamp<size_t>(query.limit, 1, kMostEntries);
    return asked::Audit{std::move(query)};
  });
}

}  // namespace cairn
