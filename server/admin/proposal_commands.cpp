// SPDX-License-Identifier: Apache-2.0
#include "server/admin/proposal_commands.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "server/admin/listing.h"
#include "server/admin/proposal_image.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr const char* kFooter =
    "A proposal is a keyframe of somebody who may not add it to the map, kept aside until an operator "
    "accepts\n"
    "or drops it. It is no part of the map before that. Proposals are off until they are switched on.\n\n"
    "Examples:\n"
    "  cairnctl proposals on desk              takes them in map desk (`--site` in place of it: in all "
    "maps)\n"
    "  cairnctl proposals                      lists those that wait\n"
    "  cairnctl proposals show 3e6f01ab-12 --save seen.png\n"
    "  cairnctl proposals accept 3e6f01ab-12 3e6f01ab-14\n"
    "  cairnctl proposals accept --all --map desk\n"
    "  cairnctl proposals drop --all --client phone-1 --yes\n"
    "  cairnctl proposals off desk";

struct Words {
  std::string map;
  std::string client;
  std::string id;
  std::vector<std::string> ids;
  std::string file;
  bool all = false;
  bool yes = false;
  bool site = false;
};

std::string share_text(uint64_t found, uint64_t expected) {
  const uint64_t percent = expected == 0 ? 0 : (100 * found + expected / 2) / expected;
  return std::to_string(found) + " of " + std::to_string(expected) + " points seen (" +
         std::to_string(percent) + " %)";
}

std::string share_text(const json& proposal, const char* found, const char* expected) {
  return share_text(proposal.value(found, uint64_t{0}), proposal.value(expected, uint64_t{0}));
}

std::string place_text(const json& proposal) {
  const json place = proposal.value("position", json::array());
  std::string text;
  for (const json& coordinate : place) {
    char number[32];
    std::snprintf(number, sizeof(number), " %.2f", coordinate.is_number() ? coordinate.get<double>() : 0.0);
    text += number;
  }
  return text;
}

void print_proposal(const json& proposal) {
  std::printf("%s %s %s  by %s %s at%s\n", padded(text_of(proposal, "id"), 14).c_str(),
              padded(text_of(proposal, "map_name"), 16).c_str(), text_of(proposal, "received").c_str(),
              padded(text_of(proposal, "client"), 16).c_str(),
              padded(share_text(proposal, "found", "expected"), 34).c_str(), place_text(proposal).c_str());
  std::printf("%s %s\n", padded("", 14).c_str(), text_of(proposal, "why").c_str());
}

Result<json> ask_for_list(AdminClient* client, const Words& words) {
  json all = json::array();
  json request{{"verb", "proposals"}};
  if (!words.map.empty()) request["map"] = words.map;
  if (!words.client.empty()) request["client"] = words.client;
  for (bool more = true; more;) {
    const auto page = client->ask(request);
    if (!page) return tl::unexpected(page.error());
    const json part = page->content.value("proposals", json::array());
    all.insert(all.end(), part.begin(), part.end());
    more = page->content.value("more", false) && !part.empty();
    if (!more) break;
    request["after_map"] = part.back().value("map", "");
    request["after"] = count_of(part.back(), "number");
  }
  return all;
}

Status list(AdminClient* client, const Words& words, bool as_json) {
  const auto all = ask_for_list(client, words);
  if (!all) return tl::unexpected(all.error());
  if (as_json) {
    std::printf("%s\n", json_text(*all, 2).c_str());
    return {};
  }
  if (all->empty()) std::fprintf(stderr, "cairnctl: no proposals wait\n");
  for (const json& proposal : *all) print_proposal(proposal);
  return {};
}

/// The image as the server keeps it, piece by piece.
Result<std::vector<uint8_t>> ask_for_image(AdminClient* client, const std::string& id) {
  std::vector<uint8_t> image;
  while (true) {
    const auto piece =
        client->ask({{"verb", "proposal-picture"}, {"proposal", id}, {"offset", image.size()}});
    if (!piece) return tl::unexpected(piece.error());
    image.insert(image.end(), piece->data.begin(), piece->data.end());
    if (piece->data.empty() || image.size() >= count_of(piece->content, "bytes")) return image;
  }
}

std::vector<MarkedPoint> points_of(const json& shown) {
  std::vector<MarkedPoint> points;
  for (const json& p : shown.value("points", json::array())) {
    const bool is_point = p.is_array() && p.size() == 3 &&
                          std::ranges::all_of(p, [](const json& n) { return n.is_number_integer(); });
    if (is_point) points.push_back({p[0].get<int>(), p[1].get<int>(), p[2].get<int>() != 0});
  }
  return points;
}

/// Whole or not at all, and in place of nothing.
Status write_new_file(const std::filesystem::path& path, const std::vector<uint8_t>& bytes) {
  std::error_code unknown;
  const std::string name = one_line(path.string());
  if (std::filesystem::exists(path, unknown))
    return fail(ErrorCode::kUsage, name + ": is there already; name another file");
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (out) return {};
  std::filesystem::remove(path, unknown);
  return fail(ErrorCode::kIo, name + ": cannot be written; see to the folder, its owner and free space");
}

Status save_image(AdminClient* client, const std::string& id, const json& shown, const std::string& file) {
  const auto image = ask_for_image(client, id);
  if (!image) return tl::unexpected(image.error());
  const auto drawn = with_points(*image, points_of(shown));
  if (!drawn) return fail(drawn.error().code, "the image of " + id + ": " + drawn.error().message);
  return write_new_file(file, *drawn);
}

Status show(AdminClient* client, const Words& words, bool as_json) {
  const auto answer = client->ask({{"verb", "proposal-show"}, {"proposal", words.id}});
  if (!answer) return tl::unexpected(answer.error());
  const json& shown = answer->content;
  if (!words.file.empty()) {
    if (Status saved = save_image(client, words.id, shown, words.file); !saved) return saved;
  }
  if (as_json) {
    std::printf("%s\n", json_text(shown, 2).c_str());
    return {};
  }
  print_proposal(shown);
  if (shown.contains("problem")) {
    std::printf("  %s\n", text_of(shown, "problem").c_str());
  } else {
    std::printf("  of the map as it is now: %s; %" PRIu64 " were measured by the client\n",
                share_text(shown, "found_now", "expected_now").c_str(), count_of(shown, "measured"));
  }
  if (!words.file.empty())
    std::printf("  %s: green squares are points that were found, red crosses are missing\n",
                one_line(words.file).c_str());
  return {};
}

/// Ids of the proposals that the words name.
Result<std::vector<std::string>> ids_of(AdminClient* client, const Words& words) {
  if (words.all != words.ids.empty())
    return fail(ErrorCode::kUsage, "which? `cairnctl proposals` lists them; ID... or --all");
  if (!words.all) return words.ids;
  const auto all = ask_for_list(client, words);
  if (!all) return tl::unexpected(all.error());
  std::vector<std::string> ids;
  for (const json& proposal : *all) ids.push_back(proposal.value("id", ""));
  return ids;
}

/// Each, whatever becomes of the others: the second of two from one place is refused once the first is a
/// keyframe. Of several, each refusal is told in its place, and in the end how many there were.
Status decide_each(AdminClient* client, const std::vector<std::string>& ids, const char* verb, bool as_json) {
  json done = json::array();
  std::optional<Error> first;
  size_t refused = 0;
  for (const std::string& id : ids) {
    const auto answer = client->ask({{"verb", verb}, {"proposal", id}});
    if (answer) {
      done.push_back(answer->content);
      if (!as_json && answer->content.contains("keyframe"))
        std::printf("%s accepted: keyframe %" PRIu64 ", by %s\n", one_line(id).c_str(),
                    count_of(answer->content, "keyframe"), text_of(answer->content, "client").c_str());
      else if (!as_json)
        std::printf("%s dropped\n", one_line(id).c_str());
      continue;
    }
    if (ids.size() > 1)
      std::fprintf(stderr, "cairnctl: %s: %s\n", one_line(id).c_str(), answer.error().message.c_str());
    done.push_back({{"id", id}, {"refused", answer.error().message}});
    if (!first) first = answer.error();
    ++refused;
    if (answer.error().code == ErrorCode::kNoServer) break;
  }
  if (as_json) std::printf("%s\n", json_text(done, 2).c_str());
  if (!first && ids.empty() && !as_json) std::fprintf(stderr, "cairnctl: no proposals wait\n");
  if (!first) return {};
  if (ids.size() > 1)
    first->message =
        std::to_string(refused) + " of " + std::to_string(ids.size()) +
        (std::string(verb) == "proposal-accept" ? " proposals not accepted" : " proposals not dropped");
  return tl::unexpected(*first);
}

Status accept(AdminClient* client, const Words& words, bool as_json) {
  const auto ids = ids_of(client, words);
  return ids ? decide_each(client, *ids, "proposal-accept", as_json) : tl::unexpected(ids.error());
}

Status drop(AdminClient* client, const Words& words, bool as_json) {
  const auto ids = ids_of(client, words);
  if (!ids) return tl::unexpected(ids.error());
  if (!words.yes && !ids->empty()) {
    const auto yes =
        confirmed("Drop " + std::to_string(ids->size()) + (ids->size() == 1 ? " proposal" : " proposals") +
                  "? Their images are gone then.");
    if (!yes) return tl::unexpected(yes.error());
    if (!*yes) return fail(ErrorCode::kRefused, "nothing was done");
  }
  return decide_each(client, *ids, "proposal-drop", as_json);
}

Status welcome(AdminClient* client, const Words& words, const json& welcome, bool as_json) {
  if (words.site == !words.map.empty())
    return fail(ErrorCode::kUsage, "where? MAP, or --site for all maps of which nothing else is said");
  return ask_and_print(
      client, {{"verb", "proposals-welcome"}, {"map", words.site ? "all" : words.map}, {"welcome", welcome}},
      as_json, [](const json& answer) { std::printf("%s\n", text_of(answer, "done").c_str()); });
}

using Run = Status (*)(AdminClient* client, const Words& words, bool as_json);

/// A callback that makes `run` the action of the line, with the words as they are once the line has been
/// read.
std::function<void()> to_run(Run run, const std::shared_ptr<Words>& words, AccessAction* action) {
  return [run, words, action] {
    *action = [run, words](AdminClient* client, bool as_json) { return run(client, *words, as_json); };
  };
}

void describe_decision(CLI::App* below, const std::shared_ptr<Words>& words) {
  below->add_option("ID", words->ids, "as listed")->check(fault_of_word);
  below->add_flag("--all", words->all, "all that wait");
  below->add_option("--map", words->map, "with --all: of one map")->check(fault_of_word);
  below->add_option("--client", words->client, "with --all: of one client")->check(fault_of_word);
}

void describe_switches(CLI::App* proposals, const std::shared_ptr<Words>& words, AccessAction* action) {
  const auto add = [&](const char* word, const char* help, const json& yes, bool has_site) {
    CLI::App* sub = proposals->add_subcommand(word, help);
    sub->add_option("MAP", words->map, "name or id")->check(fault_of_word);
    if (has_site) sub->add_flag("--site", words->site, "in all maps of which nothing else is said");
    sub->callback([=] {
      *action = [words, yes](AdminClient* client, bool as_json) {
        return welcome(client, *words, yes, as_json);
      };
    });
  };
  add("on", "keyframes of who may not add them are kept aside from now on", true, true);
  add("off", "none are; those that wait stay", false, true);
  add("default", "as in all maps of which nothing is said", nullptr, false);
}

}  // namespace

void describe_proposals(CLI::App* app, AccessAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* proposals = app->add_subcommand(
      "proposals", "keyframes kept aside of those who may not add them; without a word more, lists them");
  proposals->footer(kFooter);
  proposals->add_option("MAP", words->map, "name or id [all maps]")->check(fault_of_word);
  proposals->add_option("--client", words->client, "those of one client")->check(fault_of_word);
  proposals->callback([words, action] {
    if (!*action) to_run(list, words, action)();
  });
  CLI::App* listed = proposals->add_subcommand(
      "list",
      "id, map, when, by whom, how many of the map's points are seen in it, from where [m], and why "
      "it is no keyframe");
  listed->add_option("MAP", words->map, "name or id [all maps]")->check(fault_of_word);
  listed->callback(to_run(list, words, action));
  CLI::App* shown = proposals->add_subcommand("show", "one, and how it compares with the map as it is now");
  shown->add_option("ID", words->id, "as listed")->required()->check(fault_of_word);
  shown
      ->add_option("--save", words->file,
                   "its image, with the points of the map that are found in it and those that are missing")
      ->type_name("FILE.png");
  shown->callback(to_run(show, words, action));
  CLI::App* accepted = proposals->add_subcommand(
      "accept", "makes them keyframes, if the map maker agrees with the map as it is now");
  describe_decision(accepted, words);
  accepted->callback(to_run(accept, words, action));
  CLI::App* dropped = proposals->add_subcommand("drop", "forgets them");
  describe_decision(dropped, words);
  dropped->add_flag("--yes", words->yes, "does not ask whether it is meant");
  dropped->callback(to_run(drop, words, action));
  describe_switches(proposals, words, action);
}

}  // namespace cairn
