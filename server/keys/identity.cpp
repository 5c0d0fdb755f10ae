// SPDX-License-Identifier: Apache-2.0
#include "server/keys/identity.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "common/base/utc.h"
#include "common/io/text.h"
#include "common/map/ids.h"

namespace cairn {
namespace {

using nlohmann::json;
using nlohmann::ordered_json;

constexpr int kFormat = 1;
constexpr size_t kMostBytes = 64 << 20;

constexpr std::array<std::string_view, 4> kRoles{"client", "server", "operator", "rig"};

/// Which of the words it is, as the value of an enumeration.
template <typename Value, size_t kCount>
Result<Value> parse_word(std::string_view word, const std::array<std::string_view, kCount>& words,
                         std::string_view what) {
  const auto found = std::find(words.begin(), words.end(), word);
  if (found != words.end()) return static_cast<Value>(found - words.begin());
  std::string known;
  for (const std::string_view one : words) known.append(known.empty() ? "" : ", ").append(one);
  return fail(ErrorCode::kUsage, in_quotes(word) + " is no " + std::string(what) + "; there are " + known);
}

ordered_json to_json(const Identity& identity) {
  ordered_json row{{"role", to_string(identity.role)}, {"name", identity.name}};
  if (identity.role == IdentityRole::kOperator) row["duty"] = to_string(identity.duty);
  if (!identity.groups.empty()) row["groups"] = identity.groups;
  if (!identity.rig.empty()) row["rig"] = identity.rig;
  if (!identity.wearer.empty()) row["wearer"] = identity.wearer;
  row["issues"] = ordered_json::array();
  for (const Issue& issue : identity.issues)
    row["issues"].push_back({{"serial", issue.serial}, {"expires", to_utc(issue.expires)}});
  if (identity.revoked) row["revoked"] = to_utc(*identity.revoked);
  return row;
}

// Reading: what is wrong is thrown inside, and turned into a Result at the border.

struct Wrong {
  std::string what;
};

template <typename T>
T accepted(Result<T> result) {
  if (!result) throw Wrong{result.error().message};
  return *std::move(result);
}

std::string name_in(const json& text) {
  auto name = text.get<std::string>();
  if (!is_valid_name(name)) throw Wrong{in_quotes(name) + " is no name"};
  return name;
}

Issue issue_from(const json& row) {
  const auto serial = row.at("serial").get<std::string>();
  const bool is_hex = !serial.empty() && serial.size() <= 64 &&
                      serial.find_first_not_of("0123456789ABCDEF") == std::string::npos;
  if (!is_hex) throw Wrong{in_quotes(serial) + " is no serial number"};
  return {serial, accepted(parse_utc(row.at("expires").get<std::string>()))};
}

Identity identity_from(const json& row) {
  constexpr std::array kKeys{"role", "name", "duty", "groups", "rig", "wearer", "issues", "revoked"};
  for (const auto& [key, value] : row.items()) {
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end())
      throw Wrong{"unknown key " + in_quotes(key)};
  }
  Identity identity;
  identity.role = accepted(parse_identity_role(row.at("role").get<std::string>()));
  identity.name = name_in(row.at("name"));
  if (row.contains("duty")) identity.duty = accepted(parse_duty(row["duty"].get<std::string>()));
  for (const json& group : row.value("groups", json::array())) identity.groups.insert(name_in(group));
  if (row.contains("rig")) identity.rig = name_in(row["rig"]);
  if (row.contains("wearer")) identity.wearer = name_in(row["wearer"]);
  for (const json& issue : row.at("issues")) identity.issues.push_back(issue_from(issue));
  if (row.contains("revoked")) identity.revoked = accepted(parse_utc(row["revoked"].get<std::string>()));
  return identity;
}

Register register_from(const json& all) {
  if (all.at("format") != kFormat) throw Wrong{"another format than " + std::to_string(kFormat)};
  Register identities;
  for (const json& row : all.at("identities")) {
    try {
      Identity identity = identity_from(row);
      const std::pair key(identity.role, identity.name);
      if (!identities.emplace(key, std::move(identity)).second) throw Wrong{"is there twice"};
    } catch (const Wrong& wrong) {
      throw Wrong{"identity " + std::to_string(identities.size() + 1) + ": " + wrong.what};
    }
  }
  return identities;
}

}  // namespace

std::string_view to_string(IdentityRole role) {
  return kRoles.at(static_cast<size_t>(role));
}
Result<IdentityRole> parse_identity_role(std::string_view word) {
  return parse_word<IdentityRole>(word, kRoles, "kind of identity");
}
Result<Duty> parse_duty(std::string_view word) {
  return parse_word<Duty>(word, kDuties, "role of an operator");
}

std::string to_text(const Register& identities) {
  std::string text = "{\"format\": " + std::to_string(kFormat) + ",\n \"identities\": [";
  const char* before = "\n  ";
  for (const auto& [key, identity] : identities) {
    text += before + to_json(identity).dump();
    before = ",\n  ";
  }
  return text + "\n ]}\n";
}

Result<Register> parse_register(std::string_view text) {
  try {
    return register_from(json::parse(text));
  } catch (const Wrong& wrong) {
    return fail(ErrorCode::kDamaged, wrong.what);
  } catch (const json::exception& error) {
    return fail(ErrorCode::kDamaged, in_quotes(error.what()));
  }
}

Result<Register> read_register(const std::filesystem::path& path) {
  const auto text = read_file(path, kMostBytes);
  if (!text) return tl::unexpected(text.error());
  auto identities = parse_register(*text);
  if (!identities) return fail(identities.error().code, path.string() + ": " + identities.error().message);
  return identities;
}

}  // namespace cairn
