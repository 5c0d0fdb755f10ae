// SPDX-License-Identifier: Apache-2.0
#include "server/admin/version_commands.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <memory>
#include <optional>

#include "common/io/json_text.h"
#include "server/admin/listing.h"

namespace cairn {
namespace {

using nlohmann::json;

struct Words {
  std::string tag;
  std::string name;
  std::string client;
  bool yes = false;
};

void print_tag(const json& tag) {
  std::printf("%-32s  %s  %6" PRIu64 " keyframes %7" PRIu64 " points, by %s\n", text_of(tag, "tag").c_str(),
              text_of(tag, "time").c_str(), count_of(tag, "keyframes"), count_of(tag, "points"),
              text_of(tag, "by").c_str());
}

Status list_tags(AdminClient* client, const std::string& map, bool as_json) {
  json tags = json::array();
  json request{{"verb", "tags"}, {"map", map}};
  for (bool more = true; more;) {
    const auto page = client->ask(request);
    if (!page) return tl::unexpected(page.error());
    const json part = page->content.value("tags", json::array());
    tags.insert(tags.end(), part.begin(), part.end());
    more = page->content.value("more", false) && !part.empty();
    if (more) request["after"] = count_of(part.back(), "number");
  }
  if (as_json) {
    std::printf("%s\n", json_text(tags, 2).c_str());
    return {};
  }
  if (tags.empty()) std::fprintf(stderr, "cairnctl: no tags\n");
  for (const json& tag : tags) print_tag(tag);
  return {};
}

/// All contributors of a map, page by page: `contributors`, and how many keyframes are of `unknown` ones.
Result<json> contributors_of(AdminClient* client, const std::string& map) {
  json all = json::array();
  std::string after;
  while (true) {
    auto page = client->ask({{"verb", "contributors"}, {"map", map}, {"after", after}});
    if (!page) return tl::unexpected(page.error());
    for (json& row : page->content["contributors"]) {
      after = row.value("client", "");
      all.push_back(std::move(row));
    }
    if (!page->content.value("more", false))
      return json{{"contributors", all}, {"unknown", count_of(page->content, "unknown")}};
  }
}

Status list_contributors(AdminClient* client, const std::string& map, bool as_json) {
  const auto told = contributors_of(client, map);
  if (!told) return tl::unexpected(told.error());
  json rows = told->at("contributors");
  const uint64_t unknown = count_of(*told, "unknown");
  if (as_json) {
    if (unknown > 0) rows.push_back({{"client", nullptr}, {"keyframes", unknown}, {"ids", nullptr}});
    std::printf("%s\n", json_text(rows, 2).c_str());
    return {};
  }
  for (const json& row : rows)
    std::printf("%-32s %6" PRIu64 " keyframes  %s\n", text_of(row, "client").c_str(),
                count_of(row, "keyframes"), text_of(row, "ids").c_str());
  if (unknown > 0)
    std::printf("%-32s %6" PRIu64 " keyframes  from before contributors were kept\n", "(not known)", unknown);
  return {};
}

Status drop_contributor(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  const Status meant = confirm(words.yes, "Take all keyframes of client '" + words.client + "' out of map '" +
                                              map + "', for good? The map's tags go with them.");
  if (!meant) return meant;
  return ask_and_print(client, {{"verb", "drop-contributor"}, {"map", map}, {"client", words.client}},
                       as_json, print_map);
}

/// Each map has it or has it not: one that cannot be changed does not keep the others.
Status drop_from_all(AdminClient* client, const Words& words, bool as_json) {
  const Status meant = confirm(words.yes, "Take all keyframes of client '" + words.client +
                                              "' out of all maps, for good? The tags of these go with them.");
  if (!meant) return meant;
  const auto maps = client->maps();
  if (!maps) return tl::unexpected(maps.error());
  json changed = json::array();
  std::optional<Error> first;
  for (const json& map : (*maps)["maps"]) {
    const std::string id = map.value("id", "");
    const auto who = contributors_of(client, id);
    if (!who) return tl::unexpected(who.error());
    const bool has_any = std::ranges::any_of(
        who->at("contributors"), [&](const json& row) { return row.value("client", "") == words.client; });
    if (!has_any) continue;
    auto done = client->ask({{"verb", "drop-contributor"}, {"map", id}, {"client", words.client}});
    if (done) changed.push_back(std::move(done->content));
    if (!done && !first) first = done.error();
  }
  if (as_json) std::printf("%s\n", json_text(changed, 2).c_str());
  if (!as_json && changed.empty() && !first) std::fprintf(stderr, "cairnctl: no map has keyframes of it\n");
  if (!as_json) {
    for (const json& map : changed) print_map(map);
  }
  return first ? tl::unexpected(*first) : Status();
}

Status remove_tag(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  const Status meant = confirm(words.yes, "Forget the tag '" + words.tag + "' of map '" + map +
                                              "'? Its state cannot be had back then.");
  if (!meant) return meant;
  return ask_and_print(client, {{"verb", "untag"}, {"map", map}, {"tag", words.tag}}, as_json,
                       [](const json& tag) { std::printf("tag %s removed\n", text_of(tag, "tag").c_str()); });
}

Status roll_back(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  const Status meant = confirm(words.yes, "Roll map '" + map + "' back to '" + words.tag +
                                              "'? What has come since goes from the map; a tag keeps it.");
  if (!meant) return meant;
  return ask_and_print(client, {{"verb", "roll-back"}, {"map", map}, {"tag", words.tag}}, as_json, print_map);
}

}  // namespace

void describe_versions(CLI::App* below, const std::string* map, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* tag = below->add_subcommand(
      "tag", "keeps its state of now, to be had back; it costs what changes afterwards");
  tag->add_option("TAG", words->tag, "its name: a-z, 0-9 and -")->required()->check(fault_of_word);
  tag->callback([action, words, map] {
    *action = [=](AdminClient* client, bool as_json) {
      return ask_and_print(client, {{"verb", "tag"}, {"map", *map}, {"tag", words->tag}}, as_json, print_tag);
    };
  });
  below->add_subcommand("tags", "states that can be had back, the oldest first")->callback([action, map] {
    *action = [map](AdminClient* client, bool as_json) { return list_tags(client, *map, as_json); };
  });
  CLI::App* untag = below->add_subcommand("untag", "forgets a tag, for good; the map stays as it is");
  untag->add_option("TAG", words->tag, "its name (`tags` lists them)")->required()->check(fault_of_word);
  add_yes(untag, &words->yes);
  untag->callback([action, words, map] {
    *action = [=](AdminClient* client, bool as_json) { return remove_tag(client, *map, *words, as_json); };
  });
  CLI::App* back = below->add_subcommand(
      "rollback",
      "its keyframes, points and labels are again what they were at a tag; trackers in it go on. What there "
      "is now is kept as the tag before-rollback-N");
  back->add_option("TAG", words->tag, "its name (`tags` lists them)")->required()->check(fault_of_word);
  add_yes(back, &words->yes);
  back->callback([action, words, map] {
    *action = [=](AdminClient* client, bool as_json) { return roll_back(client, *map, *words, as_json); };
  });
  CLI::App* copy =
      below->add_subcommand("copy", "a second map like it, which goes its own way, without its tags");
  copy->add_option("NAME", words->name, "of the copy: a-z, 0-9 and -")->required()->check(fault_of_word);
  copy->callback([action, words, map] {
    *action = [=](AdminClient* client, bool as_json) {
      return ask_and_print(client, {{"verb", "copy"}, {"map", *map}, {"name", words->name}}, as_json,
                           print_map);
    };
  });
  below->add_subcommand("contributors", "who offered which of its keyframes")->callback([action, map] {
    *action = [map](AdminClient* client, bool as_json) { return list_contributors(client, *map, as_json); };
  });
  CLI::App* drop = below->add_subcommand("drop-contributor",
                                         "takes a client's keyframes out, for good, with what only they "
                                         "show; the map's tags go, too. Deleted maps, "
                                         "archives and backups keep what they have");
  drop->add_option("CLIENT", words->client, "its name")->required()->check(fault_of_word);
  add_yes(drop, &words->yes);
  drop->callback([action, words, map] {
    *action = [=](AdminClient* client, bool as_json) {
      return drop_contributor(client, *map, *words, as_json);
    };
  });
}

void describe_drop_from_all(CLI::App* maps, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* drop = maps->add_subcommand(
      "drop-contributor", "takes a client's keyframes out of all maps, as `map MAP drop-contributor`");
  drop->add_option("CLIENT", words->client, "its name")->required()->check(fault_of_word);
  add_yes(drop, &words->yes);
  drop->callback([action, words] {
    *action = [=](AdminClient* client, bool as_json) { return drop_from_all(client, *words, as_json); };
  });
}

}  // namespace cairn
