// SPDX-License-Identifier: Apache-2.0
#include "server/admin/keys_commands.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "server/keys/keystore.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr const char* kFooter =
    "The folder of the keys stays with the operator, best on a machine that is not in the network. What goes "
    "to\n"
    "a device is its security folder, whole, for --security there.\n\n"
    "Examples:\n"
    "  cairnctl keys init\n"
    "  cairnctl keys issue server\n"
    "  cairnctl keys issue client phone-1 --days 30\n"
    "  cairnctl keys issue operator ann --role administer\n"
    "  cairnctl keys renew client phone-1 && cairnctl keys revoke client phone-2\n"
    "  cairnctl keys renew --all";

struct Words {
  std::string folder = "cairn-keys";
  std::string role;
  std::string name;
  std::vector<std::string> groups;
  std::string rig;
  std::string wearer;
  std::string duty;
  int days = 0;
  bool all = false;
};

/// How long keys are good, if nothing else is asked for. Those of devices that get lost are short-lived.
std::chrono::seconds life_of(const Words& words, IdentityRole role) {
  const int standard = role == IdentityRole::kClient || role == IdentityRole::kOperator ? 30 : 365;
  return std::chrono::hours(24 * (words.days > 0 ? words.days : standard));
}

json to_json(const Identity& identity, Timestamp at) {
  json row{{"role", to_string(identity.role)},
           {"name", identity.name},
           {"groups", identity.groups},
           {"serial", nullptr},
           {"expires", nullptr},
           {"expired", true},
           {"revoked", nullptr}};
  if (!identity.issues.empty()) {
    row["serial"] = identity.issues.back().serial;
    row["expires"] = to_utc(identity.issues.back().expires);
    row["expired"] = identity.issues.back().expires <= at;
  }
  if (identity.role == IdentityRole::kOperator) row["duty"] = to_string(identity.duty);
  if (identity.revoked) row["revoked"] = to_utc(*identity.revoked);
  return row;
}

void print_row(const Identity& identity, Timestamp at) {
  const bool has_issue = !identity.issues.empty();
  std::string notes;
  if (identity.revoked) notes += "  revoked " + to_utc(*identity.revoked);
  if (has_issue && identity.issues.back().expires <= at) notes += "  expired";
  if (identity.role == IdentityRole::kOperator) notes += "  may " + std::string(to_string(identity.duty));
  for (const std::string& group : identity.groups) notes += "  in " + group;
  std::printf("%s %s %s %s%s\n", padded(std::string(to_string(identity.role)), 8).c_str(),
              padded(identity.name, 32).c_str(),
              has_issue ? to_utc(identity.issues.back().expires).c_str() : "-                   ",
              has_issue ? padded(identity.issues.back().serial, 32).c_str() : "-", notes.c_str());
}

/// Rows, or all of them as JSON.
void print_identities(const std::vector<Identity>& identities, bool as_json) {
  const Timestamp at = wall_clock_now();
  if (as_json) {
    json rows = json::array();
    for (const Identity& identity : identities) rows.push_back(to_json(identity, at));
    std::printf("%s\n", json_text(rows, 2).c_str());
    return;
  }
  std::printf("ROLE     NAME                             EXPIRES              SERIAL\n");
  for (const Identity& identity : identities) print_row(identity, at);
}

struct Made {
  Identity identity;
  std::filesystem::path folder;
};

void print_made(const std::vector<Made>& all, bool as_json) {
  json rows = json::array();
  for (const Made& made : all) {
    json row = to_json(made.identity, wall_clock_now());
    row["folder"] = path_in_json(made.folder);
    rows.push_back(std::move(row));
    if (as_json) continue;
    std::printf("%s\n", one_line(made.folder.string()).c_str());
    std::fprintf(stderr,
                 "cairnctl: %s %s: good until %s; copy the folder to its machine, whole, for --security\n",
                 to_string(made.identity.role).data(), made.identity.name.c_str(),
                 to_utc(made.identity.issues.back().expires).c_str());
  }
  if (as_json) std::printf("%s\n", json_text(rows, 2).c_str());
}

/// The server may go without a name.
Result<std::pair<IdentityRole, std::string>> who(const Words& words) {
  const auto role = parse_identity_role(words.role);
  if (!role) return tl::unexpected(role.error());
  if (!words.name.empty()) return std::pair(*role, words.name);
  if (*role == IdentityRole::kServer) return std::pair(*role, std::string("server"));
  return fail(ErrorCode::kUsage, "which " + words.role + "? its name follows");
}

Status init(const Words& words, bool as_json) {
  const Status made = Keystore::init(words.folder, wall_clock_now());
  if (!made) return made;
  if (as_json) {
    std::printf("%s\n", json_text(json{{"keys", path_in_json(words.folder)}}, 2).c_str());
  } else {
    std::printf("%s\n", one_line(words.folder).c_str());
    std::fprintf(
        stderr,
        "cairnctl: two authorities made; keep the folder safe and backed up: who has it can be anybody "
        "here. `cairnctl keys issue server` comes next\n");
  }
  return {};
}

Status issue(const Words& words, bool as_json) {
  const auto named = who(words);
  if (!named) return tl::unexpected(named.error());
  Identity wanted;
  std::tie(wanted.role, wanted.name) = *named;
  wanted.groups.insert(words.groups.begin(), words.groups.end());
  wanted.rig = words.rig;
  wanted.wearer = words.wearer;
  const bool is_operator = wanted.role == IdentityRole::kOperator;
  if (is_operator != !words.duty.empty())
    return fail(ErrorCode::kUsage, is_operator ? "an operator needs --role watch, curate or administer"
                                               : "--role is of operators");
  if (is_operator) {
    const auto duty = parse_duty(words.duty);
    if (!duty) return tl::unexpected(duty.error());
    wanted.duty = *duty;
  }
  auto keys = Keystore::open(words.folder);
  if (!keys) return tl::unexpected(keys.error());
  const auto made = keys->issue(wanted, life_of(words, wanted.role), wall_clock_now());
  if (!made) return tl::unexpected(made.error());
  print_made({{keys->identities().at(*named), *made}}, as_json);
  return {};
}

Status renew(const Words& words, bool as_json) {
  if (words.all != words.role.empty())
    return fail(ErrorCode::kUsage, "whose keys? `keys renew ROLE NAME`, or --all");
  auto keys = Keystore::open(words.folder);
  if (!keys) return tl::unexpected(keys.error());
  std::vector<std::pair<IdentityRole, std::string>> wanted;
  if (words.all) {
    for (const auto& [key, identity] : keys->identities())
      if (!identity.revoked) wanted.push_back(key);
  } else {
    const auto named = who(words);
    if (!named) return tl::unexpected(named.error());
    wanted.push_back(*named);
  }
  std::vector<Made> all;
  Status done;
  for (const auto& key : wanted) {
    const auto made = keys->renew(key.first, key.second, life_of(words, key.first), wall_clock_now());
    if (!made) {
      done = tl::unexpected(made.error());
      break;
    }
    all.push_back({keys->identities().at(key), *made});
  }
  if (done || !all.empty()) print_made(all, as_json);
  return done;
}

Status revoke(const Words& words, bool as_json) {
  const auto named = who(words);
  if (!named) return tl::unexpected(named.error());
  auto keys = Keystore::open(words.folder);
  if (!keys) return tl::unexpected(keys.error());
  if (Status revoked = keys->revoke(named->first, named->second, wall_clock_now()); !revoked) return revoked;
  const Identity& identity = keys->identities().at(*named);
  print_identities({identity}, as_json);
  std::fprintf(stderr, "cairnctl: its security folder is removed here, and the name %s is taken until %s\n",
               named->second.c_str(), to_utc(last_expiry(identity)).c_str());
  const bool is_server = named->first == IdentityRole::kServer;
  std::fprintf(stderr,
               "cairnctl: copy %s and crl.pem to the security folders of servers on other machines, crl.pem "
               "also to those of %s, and start these again\n",
               std::string(kRegisterFile).c_str(),
               is_server ? "all clients, operators and rigs, which speak to whoever has a server's keys"
                         : "rigs and of a wearer's other cameras there");
  return {};
}

Status list(const Words& words, bool as_json) {
  const auto keys = Keystore::open(words.folder);
  if (!keys) return tl::unexpected(keys.error());
  std::vector<Identity> all;
  for (const auto& [key, identity] : keys->identities()) all.push_back(identity);
  print_identities(all, as_json);
  return {};
}

}  // namespace

void describe_keys(CLI::App* app, KeysAction* action) {
  const auto words = std::make_shared<Words>();
  const auto does = [action, words](Status (*act)(const Words&, bool)) {
    return [=] { *action = [=](bool as_json) { return act(*words, as_json); }; };
  };
  CLI::App* keys = app->add_subcommand("keys", "who may take part in a secured site");
  keys->require_subcommand(1);
  keys->footer(kFooter);
  keys->add_option("--keys", words->folder, "folder of the site's keys")
      ->type_name("DIR")
      ->capture_default_str();
  const auto add = [&](const char* verb, const char* help, bool needs_role) {
    CLI::App* sub = keys->add_subcommand(verb, help);
    CLI::Option* role = sub->add_option("ROLE", words->role, "client, server, operator or rig")
                            ->check(CLI::IsMember({"client", "server", "operator", "rig"}));
    if (needs_role) role->required();
    sub->add_option("NAME", words->name, "a-z, 0-9 and - [of the server: server]");
    return sub;
  };
  const auto add_days = [&](CLI::App* sub) {
    sub->add_option("--days", words->days, "how long they are good [30, of a server or rig 365]")
        ->check(CLI::Range(1, 3650));
  };
  keys->add_subcommand("init", "makes the two authorities that sign everything else")->callback(does(init));
  CLI::App* give = add("issue", "makes keys for somebody new", true);
  add_days(give);
  give->add_option(
          "--groups", words->groups,
          "client: the groups that it is in, for `cairnctl rights grant 'group NAME'`, beside those of "
          "`rights group`")
      ->delimiter(',');
  give->add_option("--rig", words->rig, "client: the rig that carries its camera")->type_name("NAME");
  give->add_option("--wearer", words->wearer, "client: who wears it")->type_name("NAME");
  give->add_option("--role", words->duty, "operator: watch, curate or administer")
      ->check(CLI::IsMember({"watch", "curate", "administer"}));
  give->callback(does(issue));
  CLI::App* again = add("renew", "makes new keys for somebody who has some", false);
  add_days(again);
  again->add_flag("--all", words->all, "for everybody who is not revoked");
  again->callback(does(renew));
  add("revoke", "turns somebody away from now on", true)->callback(does(revoke));
  keys->add_subcommand("list", "role, name, expiry, serial, what was revoked")->callback(does(list));
}

}  // namespace cairn
