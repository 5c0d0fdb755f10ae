// SPDX-License-Identifier: Apache-2.0
// cairnctl: what an operator does to a server.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <exception>
#include <optional>
#include <string>
#include <vector>

#include "common/base/one_line.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "common/map/ids.h"
#include "server/admin/admin_client.h"
#include "server/admin/export_folder.h"
#include "server/admin/interruption.h"
#include "server/store/store.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr int kInterruptedExit = 130;

constexpr const char* kFooter =
    "Exit codes: 0 ok, 1 failed, 2 usage, 3 configuration, or a file that cannot be read or written, here or "
    "by the server (disk full), 4 no server, 5 refused, 6 damaged data, 130 interrupted\n\n"
    "Examples:\n"
    "  cairnctl maps                                   lists all maps\n"
    "  cairnctl maps export desk --format colmap --out exported\n"
    "  cairnctl maps export --out backup               an archive of every map\n"
    "  cairnctl maps import backup/desk.cairnmap\n"
    "  cairnctl map desk rename bench\n"
    "  cairnctl map bench delete && cairnctl map bench undelete\n"
    "  cairnctl maps purge bench                       removes a deleted map for good\n"
    "  cairnctl labels                                 lists the labels of all maps\n"
    "  cairnctl labels desk rename 3 'small vice'\n"
    "  cairnctl labels desk remove 3";

struct Options {
  AdminClientOptions connection;
  bool as_json = false;
  std::string map;
  std::string new_name;
  std::vector<std::string> maps;
  std::vector<std::string> files;
  std::string format = "archive";
  std::string folder = ".";
  bool for_good = false;
  std::string security;
  uint64_t label = 0;
  std::string text;
};

/// To stderr, on a terminal only.
AdminClient::Progress progress_of(const std::string& what) {
  const bool shown = isatty(STDERR_FILENO) != 0;
  return [what, shown](uint64_t bytes, uint64_t of) {
    if (shown) {
      std::fprintf(stderr, "\r%s: %.1f of %.1f MB%s", what.c_str(), static_cast<double>(bytes) * 1e-6,
                   static_cast<double>(of) * 1e-6, bytes == of ? "\n" : "");
    }
  };
}

/// As a terminal may have it: archives and peers bring texts of strangers.
std::string text_of(const json& object, const char* key) {
  return one_line(object.value(key, ""));
}

void print_map(const json& map) {
  std::printf("%-24s %s  %5d keyframes %7d points %8.1f MB%s%s\n", text_of(map, "name").c_str(),
              text_of(map, "id").c_str(), map.value("keyframes", 0), map.value("points", 0),
              map.value("memory_bytes", 0.0) * 1e-6, map.value("at_rest", false) ? "  at rest" : "",
              map.contains("frozen") ? "  frozen" : "");
  if (map.contains("frozen")) std::printf("%24s %s\n", "", text_of(map, "frozen").c_str());
  for (const json& overlap : map.value("overlaps", json::array()))
    std::printf("%24s overlaps %s: %d of its keyframes show that map, %d of that map's show this\n", "",
                text_of(overlap, "map").c_str(), overlap.value("keyframes", 0),
                overlap.value("its_keyframes", 0));
}

/// All that `show` has.
void print_whole_map(const json& map) {
  print_map(map);
  std::printf("epoch         %" PRIu64 ", revision %" PRIu64 "\n", map.value("epoch", uint64_t{0}),
              map.value("revision", uint64_t{0}));
  std::printf("plane         %s\n",
              map.value("plane_aligned", false) ? "the dominant one is Z = 0" : "none found");
  if (map.contains("reprojection_px"))
    std::printf("reprojection  %.2f px (root mean square)\n", map.value("reprojection_px", 0.0));
  for (const json& camera : map.value("cameras", json::array()))
    std::printf("camera        %dx%d %s, focal length %.1f px: %d keyframes\n", camera.value("width", 0),
                camera.value("height", 0), text_of(camera, "model").c_str(), camera.value("focal_px", 0.0),
                camera.value("keyframes", 0));
  std::printf("labels        %d\n", map.value("labels", 0));
}

void print_deleted(const json& map) {
  const std::string name = text_of(map, "name");
  const std::string id = text_of(map, "id");
  const bool damaged = map.contains("damaged");
  const char* problem = damaged ? "damaged" : "unreadable";
  const std::string why = text_of(map, problem);
  std::printf("%-24s %s  deleted, %.1f MB on disk%s%s\n", name.empty() ? "?" : name.c_str(), id.c_str(),
              map.value("bytes", 0.0) * 1e-6, why.empty() ? "" : ", ", why.empty() ? "" : problem);
  if (why.empty()) return;
  const std::string remedy = damaged ? "`cairnctl maps purge " + id + "` removes it" : "see to that";
  std::printf("%24s %s; %s\n", "", why.c_str(), remedy.c_str());
}

void print_damaged(const json& file) {
  const std::string name = text_of(file, "name");
  const std::string id = text_of(file, "id");
  std::printf("%-24s %-32s  damaged, set aside, %.1f MB: %s\n", name.empty() ? "?" : name.c_str(), id.c_str(),
              file.value("bytes", 0.0) * 1e-6, text_of(file, "file").c_str());
  if (!id.empty())
    std::printf("%24s %s\n", "",
                file.value("served", false) ? "what could be saved of it is served" : "not served");
  for (const json& reason : file.value("reasons", json::array()))
    std::printf("%24s %s\n", "", one_line(reason.get<std::string>()).c_str());
}

void print_unloaded(const json& map) {
  const std::string name = text_of(map, "name");
  std::printf("%-24s %s  not served: %s\n%24s %s\n", name.empty() ? "?" : name.c_str(),
              text_of(map, "id").c_str(), text_of(map, "file").c_str(), "", text_of(map, "reason").c_str());
  std::printf("%24s see to that and start the server again, or move the file away and import an archive\n",
              "");
}

/// All of a list, each by `print_one`.
void print_each(const json& object, const char* list, void (*print_one)(const json&)) {
  for (const json& item : object.value(list, json::array())) print_one(item);
}

void print_label(const json& label) {
  const std::time_t seconds = label.value("time", int64_t{0}) / 1'000'000'000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char when[32];
  std::strftime(when, sizeof(when), "%Y-%m-%d %H:%M:%S", &parts);
  const auto at = label.value("position", std::vector<double>(3));
  std::printf("%-24s %4" PRIu64 "  %-32s by %s, %s UTC, at %.3f %.3f %.3f%s\n", text_of(label, "map").c_str(),
              label.value("id", uint64_t{0}), text_of(label, "text").c_str(),
              text_of(label, "author").c_str(), when, at.at(0), at.at(1), at.at(2),
              label.value("kind", "") == "model" ? ", a model" : "");
}

void print(const Options& options, const json& content, const std::function<void()>& as_text) {
  if (options.as_json) {
    std::printf("%s\n", content.dump(2).c_str());
  } else {
    as_text();
  }
}

/// What there is of what there may be at most.
void print_limits(const json& status) {
  const json limits = status.value("limits", json::object());
  const int rest_after = limits.value("rest_after_s", 0);
  std::printf("maps     %d of %" PRIu64 " (--max-maps), %d of them at rest (--rest-after: %s)\n",
              status.value("maps", 0), limits.value("maps", uint64_t{0}), status.value("maps_at_rest", 0),
              rest_after > 0 ? (std::to_string(rest_after) + " s").c_str() : "never");
  std::printf("memory   %.1f of %.1f MB (--max-memory)\n", status.value("memory_bytes", 0.0) * 1e-6,
              limits.value("memory_bytes", 0.0) * 1e-6);
}

Status show_status(AdminClient* client, const Options& options) {
  const auto answer = client->ask({{"verb", "status"}});
  if (!answer) return tl::unexpected(answer.error());
  const json& s = answer->content;
  print(options, s, [&s] {
    std::printf("server   %s, version %s\nhealth   %s\nstore    %s\n", text_of(s, "server").c_str(),
                text_of(s, "version").c_str(), text_of(s, "health").c_str(),
                s.value("store", "").empty() ? "none: maps are in memory only" : text_of(s, "store").c_str());
    print_limits(s);
    const json wearers = s.value("wearers", json::object());
    const json clients = s.value("clients", json::array());
    std::printf("clients %s", clients.empty() ? " none" : "");
    for (const json& client : clients) {
      const auto name = client.get<std::string>();
      std::printf(" %s", one_line(name).c_str());
      if (wearers.contains(name)) std::printf(" (worn by %s)", text_of(wearers, name.c_str()).c_str());
    }
    std::printf("\n");
    print_each(s, "damaged", print_damaged);
    print_each(s, "unloaded", print_unloaded);
  });
  return {};
}

Status list_maps(AdminClient* client, const Options& options) {
  const auto all = client->maps();
  if (!all) return tl::unexpected(all.error());
  print(options, *all, [&all] {
    const auto is_empty = [&all](const char* list) { return all->value(list, json::array()).empty(); };
    if (is_empty("maps") && is_empty("deleted") && is_empty("damaged") && is_empty("unloaded"))
      std::fprintf(stderr, "cairnctl: no maps\n");
    print_each(*all, "maps", print_map);
    print_each(*all, "deleted", print_deleted);
    print_each(*all, "damaged", print_damaged);
    print_each(*all, "unloaded", print_unloaded);
  });
  return {};
}

void print_removed_for_good(const json& map) {
  std::printf("%s removed for good\n", text_of(map, text_of(map, "name").empty() ? "id" : "name").c_str());
}

/// What a map that was deleted is undeleted by: its name, or its id where another map has that name.
std::string handle_of(const json& deleted, AdminClient* client) {
  std::string id = text_of(deleted, "id");
  std::string name = text_of(deleted, "name");
  const auto all = client->maps();
  if (!all) return id;
  for (const char* list : {"maps", "deleted"}) {
    for (const json& other : all->value(list, json::array()))
      if (text_of(other, "id") != id && text_of(other, "name") == name) return id;
  }
  return name;
}

void print_deleted_now(const json& map, AdminClient* client) {
  std::printf("%s deleted; `cairnctl map %s undelete` puts it back\n", text_of(map, "name").c_str(),
              handle_of(map, client).c_str());
}

/// A request about one map whose answer is the map.
Status change_map(AdminClient* client, const Options& options, json request) {
  request["map"] = options.map;
  const auto answer = client->ask(request);
  if (!answer) return tl::unexpected(answer.error());
  const json& map = answer->content;
  print(options, map, [&] {
    if (request["verb"] == "show") {
      print_whole_map(map);
    } else if (request["verb"] != "delete") {
      print_map(map);
    } else if (options.for_good) {
      print_removed_for_good(map);
    } else {
      print_deleted_now(map, client);
    }
  });
  return {};
}

bool is_gone(AdminClient* client, const std::string& map) {
  const auto all = client->maps();
  return all && std::none_of((*all)["maps"].begin(), (*all)["maps"].end(),
                             [&map](const json& m) { return m.value("id", "") == map; });
}

Status list_labels(AdminClient* client, const Options& options) {
  std::vector<std::string> maps;
  if (!options.map.empty()) {
    maps.push_back(options.map);
  } else {
    const auto all = client->maps();
    if (!all) return tl::unexpected(all.error());
    for (const json& map : (*all)["maps"]) maps.push_back(map.value("id", ""));
  }
  json labels = json::array();
  for (const std::string& map : maps) {
    const auto of_map = client->labels(map);
    if (!of_map && options.map.empty() && is_gone(client, map)) continue;  // since the maps were listed
    if (!of_map) return tl::unexpected(of_map.error());
    labels.insert(labels.end(), of_map->begin(), of_map->end());
  }
  print(options, labels, [&labels] {
    if (labels.empty()) std::fprintf(stderr, "cairnctl: no labels\n");
    for (const json& label : labels) print_label(label);
  });
  return {};
}

/// `request`: what is to be done with one label, which is the answer.
Status change_label(AdminClient* client, const Options& options, json request) {
  if (options.map.empty())
    return fail(ErrorCode::kUsage, "of which map? cairnctl labels MAP rename|remove LABEL");
  request["map"] = options.map;
  request["label"] = options.label;
  const auto answer = client->ask(request);
  if (!answer) return tl::unexpected(answer.error());
  const json& label = answer->content;
  print(options, label, [&] {
    if (request["verb"] == "label-remove") {
      std::printf("label %" PRIu64 " of %s removed: %s\n", label.value("id", uint64_t{0}),
                  text_of(label, "map").c_str(), text_of(label, "text").c_str());
    } else {
      print_label(label);
    }
  });
  return {};
}

/// One map into the folder: the paths that it is left under. `staging` is within the folder.
Result<std::vector<std::filesystem::path>> export_map(AdminClient* client, const Options& options,
                                                      const StagingFolder& staging, const std::string& map) {
  const std::filesystem::path folder = options.folder;
  const auto failed = [&](const Error& error) { return tl::unexpected(staging.told_of(folder, error)); };
  if (!is_valid_name(map)) return fail(ErrorCode::kUsage, "'" + map + "' is not the name of a map");
  const std::string name = map + ".cairnmap";
  const auto got = client->download(map, staging.path() / name, progress_of(map));
  if (!got) return failed(got.error());
  std::vector<std::filesystem::path> left;
  if (options.format != "archive") {
    const auto read = read_archive(staging.path() / name);
    if (!read) return failed(read.error());
    const Status scene = leave_scene(make_scene(read->record), options.format, staging, folder / map);
    if (!scene) return tl::unexpected(scene.error());
    left.push_back(folder / map);
    if (options.format != "all") return left;
  }
  if (Status archive = leave_file(staging.path() / name, folder / name); !archive)
    return tl::unexpected(archive.error());
  left.push_back(folder / name);
  return left;
}

/// All that can be had: of a backup, one map that fails must not cost the others. Interrupted, it leaves what
/// is whole and nothing hidden.
Status export_maps(AdminClient* client, const Options& options) {
  const Interruption interruption;
  client->stop_when(Interruption::requested);
  std::vector<std::string> maps = options.maps;
  if (maps.empty()) {
    const auto all = client->maps();
    if (!all) return tl::unexpected(all.error());
    for (const json& map : (*all)["maps"]) maps.push_back(map.value("name", ""));
  }
  json exported = json::array();
  std::optional<Error> first;
  size_t whole = 0;
  for (const std::string& map : maps) {
    const auto staging = StagingFolder::make_in(options.folder);
    if (!staging) return tl::unexpected(staging.error());
    const auto paths = export_map(client, options, *staging, map);
    if (paths) {
      for (const auto& path : *paths) exported.push_back(path.string());
      ++whole;
      continue;
    }
    if (maps.size() > 1)
      std::fprintf(stderr, "cairnctl: %s: not exported: %s\n", map.c_str(), paths.error().message.c_str());
    if (!first) first = paths.error();
    if (first->code == ErrorCode::kNoServer || Interruption::requested()) break;
  }
  print(options, exported, [&exported] {
    for (const json& path : exported) std::printf("%s\n", path.get<std::string>().c_str());
  });
  if (!first) return {};
  if (maps.size() > 1)
    first->message = std::to_string(whole) + " of " + std::to_string(maps.size()) +
                     " maps exported; the first that was not: " + first->message;
  return tl::unexpected(*first);
}

Status purge_maps(AdminClient* client, const Options& options) {
  json purged = json::array();
  for (const std::string& map : options.maps) {
    auto answer = client->ask({{"verb", "purge"}, {"map", map}});
    if (!answer) return tl::unexpected(answer.error());
    purged.push_back(std::move(answer->content));
  }
  print(options, purged, [&purged] {
    for (const json& map : purged) print_removed_for_good(map);
  });
  return {};
}

Status import_maps(AdminClient* client, const Options& options) {
  json imported = json::array();
  for (const std::string& file : options.files) {
    const Status is_one = check_is_map_file(file);
    auto map = is_one ? client->upload(file, progress_of(file)) : tl::unexpected(is_one.error());
    if (!map) return fail(map.error().code, file + ": " + map.error().message);
    imported.push_back(std::move(*map));
  }
  print(options, imported, [&imported] {
    for (const json& map : imported) print_map(map);
  });
  return {};
}

/// Usage of a command with all that comes before it on the line: `cairnctl map MAP rename NAME`.
class WholeLine : public CLI::Formatter {
 public:
  std::string make_usage(const CLI::App* app, std::string /*name*/) const override {
    std::string words = app->get_name();
    for (const CLI::App* above = app->get_parent(); above != nullptr; above = above->get_parent()) {
      std::string before = above->get_name();
      for (const CLI::Option* option : above->get_options(is_positional))
        before.append(" ").append(option->get_name(true));
      words = before.append(" ").append(words);
    }
    return Formatter::make_usage(app, words);
  }

 private:
  static bool is_positional(const CLI::Option* option) { return option->get_positional(); }
};

using Action = std::function<Status(AdminClient*, const Options&)>;

/// The words of the command line; `action` is what they ask for.
void describe(CLI::App* app, Options* options, Action* action) {
  app->footer(kFooter);
  app->formatter(std::make_shared<WholeLine>());
  app->require_subcommand(1);
  app->fallthrough();
  app->add_option("--server", options->connection.server, "host of cairn-server")->capture_default_str();
  app->add_option("--domain", options->connection.domain, "DDS domain, 0 to 230")->capture_default_str();
  app->add_option("--profile", options->connection.profile,
                  "network [loopback for localhost, wifi otherwise]");
  app->add_option("--security", options->security, "DDS Security files (not available yet)")
      ->type_name("DIR");
  app->add_flag("--json", options->as_json, "for machines");
  app->set_version_flag("--version", "cairnctl " + std::string(version()));

  app->add_subcommand("status", "how the server is, and what of its limits is used")->callback([action] {
    *action = show_status;
  });
  CLI::App* maps = app->add_subcommand("maps", "all maps; without a word more, lists them");
  maps->callback([action] {
    if (!*action) *action = list_maps;
  });
  maps->add_subcommand(
          "list",
          "name, id, size, which other maps it overlaps; deleted ones; files set aside as damaged or not "
          "loaded, and why")
      ->callback([action] { *action = list_maps; });
  CLI::App* out = maps->add_subcommand("export", "maps into files");
  out->add_option("MAP", options->maps, "names or ids [all]");
  out->add_option("--out", options->folder, "folder")->capture_default_str();
  out->add_option("--format", options->format,
                  "archive can be imported again; the others, for other programs, go into a folder of the "
                  "map's name. An "
                  "earlier export there is replaced, other files are not")
      ->check(CLI::IsMember({"archive", "colmap", "colmap-text", "ply", "all"}))
      ->capture_default_str();
  out->callback([action] { *action = export_maps; });
  CLI::App* in = maps->add_subcommand("import", "archives into the server");
  in->add_option("FILE", options->files, "archives")->required();
  in->callback([action] { *action = import_maps; });
  CLI::App* purge = maps->add_subcommand("purge", "removes deleted maps for good");
  purge->add_option("MAP", options->maps, "names or ids of deleted maps")->required();
  purge->callback([action] { *action = purge_maps; });

  CLI::App* map = app->add_subcommand("map", "one map");
  map->add_option("MAP", options->map, "its name or id")->required();
  map->require_subcommand(1);
  const auto add = [&](const char* word, const char* help, const char* verb) {
    CLI::App* sub = map->add_subcommand(word, help);
    sub->callback([action, verb] {
      *action = [verb](AdminClient* client, const Options& o) {
        return change_map(client, o, {{"verb", verb}, {"name", o.new_name}, {"for_good", o.for_good}});
      };
    });
    return sub;
  };
  add("show", "what it is: size, epoch, plane, reprojection error, cameras, labels", "show");
  add("rename", "calls it otherwise", "rename")
      ->add_option("NAME", options->new_name, "a-z, 0-9 and -")
      ->required();
  add("delete", "takes it out of service; with --store it can be had back", "delete")
      ->add_flag("--for-good", options->for_good, "from a server without --store, where it cannot");
  add("undelete", "puts it back into service", "undelete");
}

std::string check_label_id(const std::string& text) {
  const bool is_number =
      !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
  return is_number ? "" : "'" + text + "' is not the id of a label; `cairnctl labels` lists them";
}

void describe_labels(CLI::App* app, Options* options, Action* action) {
  CLI::App* labels =
      app->add_subcommand("labels", "what people have said of places; without a word more, lists it");
  labels->add_option("MAP", options->map, "name or id [all maps]");
  labels->callback([action] {
    if (!*action) *action = list_labels;
  });
  labels->add_subcommand("list", "map, id, text, author, time, place [m]")->callback([action] {
    *action = list_labels;
  });
  CLI::App* rename = labels->add_subcommand("rename", "says something else there");
  rename->add_option("LABEL", options->label, "its id")->required()->check(check_label_id);
  rename->add_option("TEXT", options->text, "at most 256 bytes")->required();
  rename->callback([action] {
    *action = [](AdminClient* client, const Options& o) {
      return change_label(client, o, {{"verb", "label-rename"}, {"text", o.text}});
    };
  });
  CLI::App* remove = labels->add_subcommand("remove", "says nothing any more there");
  remove->add_option("LABEL", options->label, "its id")->required()->check(check_label_id);
  remove->callback([action] {
    *action = [](AdminClient* client, const Options& o) {
      return change_label(client, o, {{"verb", "label-remove"}});
    };
  });
}

int run(int argc, char** argv) {
  CLI::App app("Looks after the maps of a cairn-server and what is written in them.", "cairnctl");
  Options options;
  Action action;
  describe(&app, &options, &action);
  describe_labels(&app, &options, &action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (const auto unknown = unknown_word(app, error)) {
      std::fprintf(stderr, "cairnctl: %s\nRun with --help for more information.\n", unknown->c_str());
      return exit_code(ErrorCode::kUsage);
    }
    return app.exit(error) == 0 ? 0 : exit_code(ErrorCode::kUsage);
  }
  if (!options.security.empty()) {
    std::fprintf(stderr, "cairnctl: --security: DDS Security is not available yet\n");
    return exit_code(ErrorCode::kUsage);
  }
  std::signal(SIGXFSZ, SIG_IGN);  // a file at its limit is an error of that write
  auto client = AdminClient::connect(options.connection);
  Status done = client ? action(&*client, options) : tl::unexpected(client.error());
  if (std::fflush(stdout) != 0 && done)
    done = fail(ErrorCode::kIo, std::string("standard output: cannot be written: ") + std::strerror(errno));
  if (done) return 0;
  std::fprintf(stderr, "cairnctl: %s\n", done.error().message.c_str());
  return Interruption::requested() ? kInterruptedExit : exit_code(done.error().code);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  try {
    return cairn::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cairnctl: internal error: %s\n", error.what());
    return 1;
  }
}
