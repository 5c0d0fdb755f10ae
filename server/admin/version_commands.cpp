// SPDX-License-Identifier: Apache-2.0
#include "server/admin/version_commands.h"

#include <cinttypes>
#include <cstdio>
#include <memory>

#include "common/io/json_text.h"
#include "server/admin/listing.h"

namespace cairn {
namespace {

using nlohmann::json;

struct Words {
  std::string tag;
  std::string name;
  bool yes = false;
};

void print_tag(const json& tag) {
  std::printf("%-32s  %s  %6" PRIu64 " keyframes %7" PRIu64 " points, by %s\n", text_of(tag, "tag").c_str(),
              text_of(tag, "time").c_str(), tag.value("keyframes", uint64_t{0}),
              tag.value("points", uint64_t{0}), text_of(tag, "by").c_str());
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
    if (more) request["after"] = part.back().value("number", uint64_t{0});
  }
  if (as_json) {
    std::printf("%s\n", json_text(tags, 2).c_str());
    return {};
  }
  if (tags.empty()) std::fprintf(stderr, "cairnctl: no tags\n");
  for (const json& tag : tags) print_tag(tag);
  return {};
}

Status roll_back(AdminClient* client, const std::string& map, const Words& words, bool as_json) {
  if (!words.yes) {
    const auto yes = confirmed("Roll map '" + map + "' back to '" + words.tag +
                               "'? What has come since goes from the map; a tag keeps it.");
    if (!yes) return tl::unexpected(yes.error());
    if (!*yes) return fail(ErrorCode::kRefused, "nothing was done");
  }
  return ask_and_print(client, {{"verb", "roll-back"}, {"map", map}, {"tag", words.tag}}, as_json, print_map);
}

}  // namespace

void describe_versions(CLI::App* below, const std::string* map, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  const auto add = [&](const char* word, const char* help, const char* verb,
                       const std::function<void(const json&)>& print) {
    CLI::App* sub = below->add_subcommand(word, help);
    sub->add_option("TAG", words->tag, "its name: a-z, 0-9 and -")->required()->check(fault_of_word);
    sub->callback([action, words, map, verb, print] {
      *action = [=](AdminClient* client, bool as_json) {
        return ask_and_print(client, {{"verb", verb}, {"map", *map}, {"tag", words->tag}}, as_json, print);
      };
    });
  };
  add("tag", "keeps its state of now, to be had back; it costs what changes afterwards", "tag", print_tag);
  below->add_subcommand("tags", "states that can be had back, the oldest first")->callback([action, map] {
    *action = [map](AdminClient* client, bool as_json) { return list_tags(client, *map, as_json); };
  });
  add("untag", "forgets a tag; the map stays as it is", "untag",
      [](const json& tag) { std::printf("tag %s removed\n", text_of(tag, "tag").c_str()); });
  CLI::App* back = below->add_subcommand(
      "rollback",
      "its keyframes, points and labels are again what they were at a tag; trackers in it go on. What there "
      "is now is kept as the tag before-rollback-N");
  back->add_option("TAG", words->tag, "its name (`tags` lists them)")->required()->check(fault_of_word);
  back->add_flag("--yes", words->yes, "does not ask whether it is meant");
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
}

}  // namespace cairn
