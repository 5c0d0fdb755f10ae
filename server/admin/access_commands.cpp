// SPDX-License-Identifier: Apache-2.0
#include "server/admin/access_commands.h"

#include <chrono>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "server/admin/asking.h"
#include "server/admin/listing.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr const char* kRightsFooter =
    "Rights: none, read (finds itself in the map and receives it), add (keyframes and labels), write "
    "(changes labels, too),\n"
    "manage. WHO: a client's name, \"group NAME\" or everyone. A grant for a map is before one for all maps, "
    "and one for\n"
    "the client before one for its groups before one for everyone.\n\n"
    "Examples:\n"
    "  cairnctl rights                                        all rules\n"
    "  cairnctl rights grant phone-1 desk write\n"
    "  cairnctl rights grant phone-1 desk write --margin 0.5   within the map's present bounds and half a "
    "metre\n"
    "  cairnctl rights grant everyone all read\n"
    "  cairnctl rights group crew phone-1 phone-2\n"
    "  cairnctl rights grant 'group crew' all add --days 7\n"
    "  cairnctl rights revoke phone-1 desk\n"
    "  cairnctl rights explain phone-2 desk";

/// Values of all words that these commands take.
struct Words {
  std::string to;
  std::string map;
  std::string right;
  std::vector<double> box;
  std::vector<double> sphere;
  std::optional<double> margin;
  bool unbounded = false;
  std::string until;
  int days = 0;
  std::string group;
  std::vector<std::string> members;
  std::string may;
  std::string client;
  std::string why;
  std::string who, what, object, from;
  int limit = 50;
};

/// Prints the note of an answer, if there is one: what may not be as it was meant.
void print_note(const json& answer) {
  if (const std::string note = text_of(answer, "note"); !note.empty())
    std::fprintf(stderr, "cairnctl: note: %s\n", note.c_str());
}

void print_done(const json& answer) {
  std::printf("%s\n", text_of(answer, "done").c_str());
  print_note(answer);
}

AccessAction change(json request) {
  return [request = std::move(request)](AdminClient* client, bool as_json) {
    return ask_and_print(client, request, as_json, print_done);
  };
}

void print_grant(const json& rule) {
  std::string map = text_of(rule, "name");
  if (map.empty()) map = rule.contains("map") ? text_of(rule, "map") : "all maps";
  std::printf("  %s %s %s", padded(text_of(rule, "to"), 28).c_str(), padded(map, 20).c_str(),
              text_of(rule, "right").c_str());
  if (rule.contains("within")) std::printf(" within %s", text_of(rule, "within").c_str());
  if (rule.contains("until"))
    std::printf(" until %s%s", text_of(rule, "until").c_str(),
                rule.value("expired", false) ? " (expired)" : "");
  std::printf(", by %s\n", text_of(rule, "by").c_str());
}

void print_closures(const json& all, const char* list, const char* key, const char* heading) {
  for (const json& rule : all.value(list, json::array())) {
    const std::string why = text_of(rule, "why");
    std::string what = text_of(rule, "name");
    if (what.empty()) what = text_of(rule, key);
    std::printf("%s %s, by %s since %s%s%s\n", heading, what.c_str(), text_of(rule, "by").c_str(),
                text_of(rule, "since").c_str(), why.empty() ? "" : ": ", why.c_str());
  }
}

void print_rights(const json& all) {
  std::printf("default: %s; who is not named %s maps\n", text_of(all, "default").c_str(),
              all.value("create", false) ? "makes" : "makes no");
  if (const json grants = all.value("grants", json::array()); !grants.empty()) {
    std::printf("grants:\n");
    for (const json& rule : grants) print_grant(rule);
  }
  for (const json& rule : all.value("creators", json::array()))
    std::printf("%s %s maps\n", text_of(rule, "to").c_str(), rule.value("may", false) ? "makes" : "makes no");
  for (const json& rule : all.value("groups", json::array())) {
    std::printf("group %s:", text_of(rule, "group").c_str());
    for (const json& member : rule.value("members", json::array()))
      std::printf(" %s", one_line(member.get<std::string>()).c_str());
    std::printf("\n");
  }
  print_closures(all, "frozen", "map", "frozen: map");
  print_closures(all, "blocked", "client", "blocked: client");
  if (all.value("proposals", false)) std::printf("proposals are taken in all maps\n");
  for (const json& rule : all.value("proposals_in", json::array())) {
    const std::string name = text_of(rule, text_of(rule, "name").empty() ? "map" : "name");
    std::printf("proposals in map %s: %s\n", name.c_str(), rule.value("welcome", false) ? "on" : "off");
  }
  if (const std::string note = text_of(all, "note"); !note.empty()) std::printf("%s\n", note.c_str());
}

void print_explanation(const json& said) {
  std::printf("in map %s: %s\n", text_of(said, "map").c_str(), text_of(said, "reason").c_str());
  for (const json& rule : said.value("rules", json::array()))
    std::printf("  %s %s\n", padded(text_of(rule, "part"), 14).c_str(), text_of(rule, "rule").c_str());
  for (const json& member : said.value("groups", json::array())) {
    const bool by_keys = member.value("by_keys", false);
    const bool by_rights = member.value("by_rights", false);
    std::printf("in group %s, as %s%s%s\n", text_of(member, "group").c_str(), by_keys ? "its keys say" : "",
                by_keys && by_rights ? " and " : "", by_rights ? "`rights group` said" : "");
  }
  std::printf("%s\n", text_of(said, "create_reason").c_str());
  print_note(said);
}

bool has_extent(const Words& words) {
  return !words.box.empty() || !words.sphere.empty() || words.margin.has_value();
}

/// Puts the extent that the words name into a request, if they name one.
void put_extent(const Words& words, json* request) {
  const auto corner = [&](size_t at) { return json{words.box[at], words.box[at + 1], words.box[at + 2]}; };
  if (!words.box.empty()) (*request)["within"] = {{"box", {corner(0), corner(3)}}};
  if (!words.sphere.empty()) {
    (*request)["within"] = {{"center", {words.sphere[0], words.sphere[1], words.sphere[2]}},
                            {"radius", words.sphere[3]}};
  }
  if (words.margin) (*request)["within"] = {{"margin", *words.margin}};
}

Status grant(AdminClient* client, const Words& words, bool as_json) {
  json request{{"verb", "rights-grant"}, {"to", words.to}, {"map", words.map}, {"right", words.right}};
  put_extent(words, &request);
  if (!words.until.empty()) request["until"] = words.until;
  if (words.days > 0) {
    const auto now =
        std::chrono::system_clock::now().time_since_epoch() + std::chrono::hours(24 * words.days);
    request["until"] = to_utc({std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()});
  }
  return ask_and_print(client, request, as_json, print_done);
}

void add_extent(CLI::App* below, Words* words) {
  CLI::Option* box =
      below->add_option("--box", words->box, "the map grows within: x y z of both corners [m]")->expected(6);
  CLI::Option* sphere =
      below->add_option("--sphere", words->sphere, "the map grows within: x y z of the centre, radius [m]")
          ->expected(4);
  CLI::Option* margin = below->add_option(
      "--margin", words->margin,
      "the map grows within the bounds of its present points and cameras and so much more [m]");
  box->excludes(sphere)->excludes(margin);
  sphere->excludes(margin);
}

void describe_grant(CLI::App* rights, const std::shared_ptr<Words>& words, AccessAction* action) {
  CLI::App* grant_words =
      rights->add_subcommand("grant", "lets somebody do something; replaces what was granted");
  grant_words->add_option("WHO", words->to, "a client, \"group NAME\" or everyone")
      ->required()
      ->check(fault_of_word);
  grant_words->add_option("MAP", words->map, "name or id, or all")->required()->check(fault_of_word);
  grant_words->add_option("RIGHT", words->right, "none, read, add, write or manage")->required();
  add_extent(grant_words, words.get());
  CLI::Option* until =
      grant_words->add_option("--until", words->until, "2027-01-31 or 2027-01-31T12:00:00Z (UTC)");
  grant_words->add_option("--days", words->days, "from now on")->check(CLI::Range(1, 3650))->excludes(until);
  grant_words->callback([action, words] {
    *action = [words](AdminClient* client, bool as_json) { return grant(client, *words, as_json); };
  });
}

void describe_rights(CLI::App* app, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* rights = app->add_subcommand("rights", "who may do what; without a word more, all rules");
  rights->footer(kRightsFooter);
  rights->callback([action] {
    if (*action) return;
    *action = [](AdminClient* client, bool as_json) {
      return ask_and_print(client, {{"verb", "rights"}}, as_json, print_rights);
    };
  });
  describe_grant(rights, words, action);
  CLI::App* revoke = rights->add_subcommand("revoke", "takes back what was granted");
  revoke->add_option("WHO", words->to, "a client, \"group NAME\" or everyone")
      ->required()
      ->check(fault_of_word);
  revoke->add_option("MAP", words->map, "name or id, or all")->required()->check(fault_of_word);
  revoke->callback([action, words] {
    *action = change({{"verb", "rights-revoke"}, {"to", words->to}, {"map", words->map}});
  });
  CLI::App* explain = rights->add_subcommand("explain", "why a client may or may not do something in a map");
  explain->add_option("CLIENT", words->client, "its name")->required()->check(fault_of_word);
  explain->add_option("MAP", words->map, "name or id")->required()->check(fault_of_word);
  explain->callback([action, words] {
    *action = [words](AdminClient* client, bool as_json) {
      return ask_and_print(client,
                           {{"verb", "rights-explain"}, {"client", words->client}, {"map", words->map}},
                           as_json, print_explanation);
    };
  });
  CLI::App* standard = rights->add_subcommand("default", "of who is not named by any grant");
  standard->add_option("RIGHT", words->right, "none, read, add, write or manage")->required();
  standard->add_option("--create", words->may, "whether such a one makes maps")
      ->check(CLI::IsMember({"yes", "no"}));
  standard->callback([action, words] {
    json request{{"verb", "rights-default"}, {"right", words->right}};
    if (!words->may.empty()) request["create"] = words->may == "yes";
    *action = change(std::move(request));
  });
  CLI::App* create = rights->add_subcommand("create", "who makes maps");
  create->add_option("WHO", words->to, "a client, \"group NAME\" or everyone")
      ->required()
      ->check(fault_of_word);
  create->add_option("MAY", words->may, "inherit: as its groups and the default say")
      ->required()
      ->check(CLI::IsMember({"yes", "no", "inherit"}));
  create->callback([action, words] {
    json request{{"verb", "rights-create"}, {"to", words->to}, {"may", nullptr}};
    if (words->may != "inherit") request["may"] = words->may == "yes";
    *action = change(std::move(request));
  });
  CLI::App* group =
      rights->add_subcommand("group", "who belongs to a group, from now on; nobody: removes it");
  group->add_option("GROUP", words->group, "its name")->required()->check(fault_of_word);
  group->add_option("CLIENT", words->members, "names of clients")->check(fault_of_word);
  group->callback([action, words] {
    *action = change({{"verb", "rights-group"}, {"group", words->group}, {"members", words->members}});
  });
}

std::string corner_of(const json& bounds, const char* which) {
  const json corner = bounds.value(which, json::array());
  std::string text;
  for (const json& value : corner) {
    char number[32];
    std::snprintf(number, sizeof(number), "%s%.2f", text.empty() ? "" : " ", value.get<double>());
    text += number;
  }
  return text;
}

/// Those of the rules that limit growth in this map to bounds; rules for all maps are among them.
json grants_within(const json& rules, const json& map) {
  json grants = json::array();
  for (const json& rule : rules.value("grants", json::array())) {
    const bool is_its = !rule.contains("map") || rule["map"] == map.value("id", "");
    if (is_its && rule.contains("within")) grants.push_back(rule);
  }
  return grants;
}

Status show_extent(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  if (has_extent(words) || words.unbounded)
    return fail(ErrorCode::kUsage, "whose? Say a client, \"group NAME\" or everyone");
  const auto shown = client->ask({{"verb", "show"}, {"map", map}});
  if (!shown) return tl::unexpected(shown.error());
  const auto rules = client->ask({{"verb", "rights"}});
  if (!rules) return tl::unexpected(rules.error());
  const json bounds = shown->content.value("bounds", json::object());
  const json grants = grants_within(rules->content, shown->content);
  if (as_json) {
    std::printf("%s\n", json_text(json{{"bounds", bounds}, {"grants", grants}}, 2).c_str());
    return {};
  }
  std::printf("%s: its points, but for those farthest out, are within %s and %s [m]\n",
              text_of(shown->content, "name").c_str(), corner_of(bounds, "min").c_str(),
              corner_of(bounds, "max").c_str());
  if (grants.empty()) std::printf("who may add or write may let it grow anywhere\n");
  for (const json& rule : grants) print_grant(rule);
  return {};
}

/// The right and its expiry stay.
Status set_extent(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  if (has_extent(words) == words.unbounded)
    return fail(ErrorCode::kUsage, "say --box, --sphere, --margin or --unbounded");
  json request{{"verb", "map-extent"}, {"to", words.to}, {"map", map}};
  put_extent(words, &request);
  return ask_and_print(client, request, as_json, print_done);
}

void print_clients(const json& clients) {
  if (clients.empty()) std::fprintf(stderr, "cairnctl: no clients\n");
  for (const json& client : clients) {
    const std::string wearer = text_of(client, "wearer");
    const std::string map = text_of(client, "map");
    std::printf("%s %s%s%s%s%s%s\n", padded(text_of(client, "name"), 33).c_str(),
                client.value("connected", false) ? "connected"
                : client.value("revoked", false) ? "revoked"
                                                 : "away",
                client.value("blocked", false) ? ", blocked" : "", map.empty() ? "" : ", in ", map.c_str(),
                wearer.empty() ? "" : ", worn by ", wearer.c_str());
  }
}

Status list_clients(AdminClient* client, bool as_json) {
  const auto answer = client->ask({{"verb", "clients"}});
  if (!answer) return tl::unexpected(answer.error());
  const json clients = answer->content.value("clients", json::array());
  if (as_json) {
    std::printf("%s\n", json_text(clients, 2).c_str());
  } else {
    print_clients(clients);
  }
  return {};
}

void describe_clients(CLI::App* app, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* clients =
      app->add_subcommand("clients", "trackers; without a word more, lists those that are known");
  const auto list = [action] { *action = list_clients; };
  clients->callback([action, list] {
    if (!*action) list();
  });
  clients->add_subcommand("list", "name, whether connected or blocked, the map it is in, who wears it")
      ->callback(list);
  const auto add = [&](const char* word, const char* help, const char* verb) {
    CLI::App* below = clients->add_subcommand(word, help);
    below->add_option("CLIENT", words->client, "its name")->required()->check(fault_of_word);
    below->callback([action, words, verb] {
      *action = change({{"verb", verb}, {"client", words->client}, {"why", words->why}});
    });
    return below;
  };
  add("block", "keeps it out until it is unblocked: it may do nothing", "client-block")
      ->add_option("--why", words->why, "for its user and the audit log")
      ->check(fault_of_word);
  add("kick", "ends its tracker: it is not served until it is started again", "client-kick");
  add("unblock", "lets it in again, with the rights that it has", "client-unblock");
}

void print_entry(const json& entry) {
  const std::string object = text_of(entry, "object");
  const std::string outcome = text_of(entry, "outcome");
  std::printf("%s  %s %s%s%s%s%s\n", text_of(entry, "time").c_str(),
              padded(text_of(entry, "who"), 24).c_str(), text_of(entry, "action").c_str(),
              object.empty() ? "" : ": ", object.c_str(), outcome == "done" ? "" : "; ",
              outcome == "done" ? "" : outcome.c_str());
}

Status show_audit(AdminClient* client, const Words& words, bool as_json) {
  constexpr int kPage = 500;
  json entries = json::array();
  json request{{"verb", "audit"},        {"who", words.who},   {"action", words.what},
               {"object", words.object}, {"from", words.from}, {"until", words.until}};
  while (static_cast<int>(entries.size()) < words.limit) {
    request["limit"] = std::min(kPage, words.limit - static_cast<int>(entries.size()));
    const auto answer = client->ask(request);
    if (!answer) return tl::unexpected(answer.error());
    const json page = answer->content.value("entries", json::array());
    if (page.empty()) break;
    entries.insert(entries.end(), page.begin(), page.end());
    request["before"] = count_of(page.back(), "number");
  }
  if (as_json) {
    std::printf("%s\n", json_text(entries, 2).c_str());
    return {};
  }
  if (entries.empty()) std::fprintf(stderr, "cairnctl: no such entry\n");
  for (const json& entry : entries) print_entry(entry);
  return {};
}

void describe_audit(CLI::App* app, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* audit = app->add_subcommand("audit", "who did what, the newest first");
  audit->footer(
      "Maps made, labels placed, renamed and removed, what operators did and who was turned away are here. "
      "Who contributed which keyframe is kept in each map: `cairnctl map NAME contributors`.\n\n"
      "Examples:\n"
      "  cairnctl audit --who ann\n"
      "  cairnctl audit --action rights --from 2027-01-01 --limit 1000\n"
      "  cairnctl audit --json --limit 100000 > audit.json");
  audit->add_option("--who", words->who, "a name, or \"operator NAME\", \"client NAME\", server")
      ->check(fault_of_word);
  audit->add_option("--action", words->what, "begins so: rights, map delete")->check(fault_of_word);
  audit->add_option("--object", words->object, "what it was done to contains this")->check(fault_of_word);
  audit->add_option("--from", words->from, "2027-01-31 or 2027-01-31T12:00:00Z (UTC)");
  audit->add_option("--until", words->until, "likewise; not included");
  audit->add_option("--limit", words->limit, "entries at most")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  audit->callback([action, words] {
    *action = [words](AdminClient* client, bool as_json) { return show_audit(client, *words, as_json); };
  });
}

}  // namespace

void describe_access(CLI::App* app, AccessAction* action) {
  describe_rights(app, action);
  describe_clients(app, action);
  describe_audit(app, action);
}

void describe_freeze(CLI::App* below, const std::string* map, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* freeze = below->add_subcommand(
      "freeze", "it is found and tracked, and takes nothing from any client; operators may still change it");
  freeze->add_option("--why", words->why, "for who is refused and the audit log")->check(fault_of_word);
  freeze->callback([action, words, map] {
    *action = change({{"verb", "map-freeze"}, {"map", *map}, {"why", words->why}});
  });
  below->add_subcommand("unfreeze", "it takes keyframes and labels again")->callback([action, map] {
    *action = change({{"verb", "map-unfreeze"}, {"map", *map}});
  });
}

void describe_extent(CLI::App* below, const std::string* map, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* extent = below->add_subcommand("extent",
                                           "its bounds, and who may let it grow within which; with WHO, says "
                                           "so anew: the right to add or write stays");
  extent->add_option("WHO", words->to, "a client, \"group NAME\" or everyone")->check(fault_of_word);
  add_extent(extent, words.get());
  extent->add_flag("--unbounded", words->unbounded, "the map grows anywhere");
  extent->footer(
      "An extent is a grant of its own, for this map: `cairnctl rights revoke WHO MAP` takes it back, with "
      "the right.\n\n"
      "Examples:\n"
      "  cairnctl map desk extent\n"
      "  cairnctl map desk extent everyone --margin 0.5\n"
      "  cairnctl map desk extent phone-1 --box -1 -1 0 1 1 2\n"
      "  cairnctl map desk extent phone-1 --unbounded");
  extent->callback([action, words, map] {
    *action = [words, map](AdminClient* client, bool as_json) {
      return words->to.empty() ? show_extent(client, *map, *words, as_json)
                               : set_extent(client, *map, *words, as_json);
    };
  });
}

}  // namespace cairn
