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
#include <exception>
#include <optional>
#include <string>
#include <vector>

#include "common/base/exit_deadline.h"
#include "common/base/help_formats.h"
#include "common/base/log.h"
#include "common/base/unknown_word.h"
#include "common/base/utf8.h"
#include "common/base/version.h"
#include "common/io/json_text.h"
#include "common/io/text.h"
#include "common/map/ids.h"
#include "common/wire/log_redirect.h"
#include "common/wire/security.h"
#include "server/admin/access_commands.h"
#include "server/admin/admin_client.h"
#include "server/admin/doctor.h"
#include "server/admin/export_folder.h"
#include "server/admin/interruption.h"
#include "server/admin/keys_commands.h"
#include "server/admin/listing.h"
#include "server/admin/proposal_commands.h"
#include "server/admin/rig_commands.h"
#include "server/admin/store_commands.h"
#include "server/admin/version_commands.h"
#include "server/admin/watch_commands.h"
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
    "  cairnctl maps purge bench                       removes a deleted map for good, once confirmed\n"
    "  cairnctl labels                                 lists the labels of all maps\n"
    "  cairnctl labels desk rename 3 'small vice'\n"
    "  cairnctl labels desk remove 3                   once confirmed\n"
    "  cairnctl rights grant phone-1 desk write        who may do what; see `cairnctl rights --help`\n"
    "  cairnctl map desk freeze                        it takes nothing from any client\n"
    "  cairnctl map desk tag monday                    keeps its state\n"
    "  cairnctl map desk rollback monday               and has it back\n"
    "  cairnctl backup monday.tar                      all of the store, while the server runs\n"
    "  cairnctl audit                                  who did what\n"
    "  cairnctl proposals                              keyframes kept aside of those who may not add them\n"
    "  cairnctl rigs                                   lists the rigs that the server hears\n"
    "  cairnctl rig shoulder stop                      emergency stop of a rig\n"
    "  cairnctl keys list                              who may take part in a secured site";

constexpr const char* kExportFooter =
    "COLMAP, and what reads its models (3-D Gaussian splatting, nerfstudio and other radiance fields) with\n"
    "pinhole cameras only:\n"
    "  cairnctl maps export desk --format colmap --rgb --out exported\n"
    "  colmap image_undistorter --image_path exported/desk/images --input_path exported/desk/sparse "
    "--output_path undistorted\n"
    "leaves undistorted/images and undistorted/sparse (where `sparse/0` is expected, move its files there).\n"
    "Cameras without distortion are exported as PINHOLE at once.";

struct Options {
  AdminClientOptions connection;
  bool as_json = false;
  std::string map;
  std::string new_name;
  std::vector<std::string> maps;
  std::vector<std::string> files;
  std::string format = "archive";
  std::string folder = ".";
  bool rgb = false;
  bool for_good = false;
  bool yes = false;
  uint64_t label = 0;
  std::string text;
};

/// Shows the progress of a transfer on stderr, on a terminal only.
AdminClient::Progress progress_of(const std::string& what) {
  const bool shown = isatty(STDERR_FILENO) != 0;
  return [what = one_line(what), shown](uint64_t bytes, uint64_t of) {
    if (shown) {
      std::fprintf(stderr, "\r%s: %.1f of %.1f MB%s", what.c_str(), static_cast<double>(bytes) * 1e-6,
                   static_cast<double>(of) * 1e-6, bytes == of ? "\n" : "");
    }
  };
}

/// Prints all items of a list, each by `print_one`.
void print_each(const json& object, const char* list, void (*print_one)(const json&)) {
  for (const json& item : object.value(list, json::array())) print_one(item);
}

void print(const Options& options, const json& content, const std::function<void()>& as_text) {
  if (options.as_json) {
    std::printf("%s\n", json_text(content, 2).c_str());
  } else {
    as_text();
  }
}

/// Prints how much there is of what the server limits, and the limits.
void print_limits(const json& status) {
  const json limits = status.value("limits", json::object());
  const uint64_t idle_after = count_of(limits, "rest_after_s");
  std::printf("maps     %" PRIu64 " of %" PRIu64 " (--max-maps), %" PRIu64
              " of them idle (--idle-after: %s)\n",
              count_of(status, "maps"), count_of(limits, "maps"), count_of(status, "maps_at_rest"),
              idle_after > 0 ? (std::to_string(idle_after) + " s").c_str() : "never");
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

Status list_rigs(AdminClient* client, const Options& options) {
  const auto answer = client->ask({{"verb", "rigs"}});
  if (!answer) return tl::unexpected(answer.error());
  const json rigs = answer->content.value("rigs", json::array());
  print(options, rigs, [&] {
    if (rigs.empty()) std::fprintf(stderr, "cairnctl: no rigs\n");
    print_each(answer->content, "rigs", print_rig);
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
      std::printf("label %" PRIu64 " of %s removed: %s\n", count_of(label, "id"),
                  text_of(label, "map").c_str(), text_of(label, "text").c_str());
    } else {
      print_label(label);
    }
  });
  return {};
}

/// Exports one map into the folder. Returns the paths under which it is left. `staging` is within the folder.
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
    ExportedScene scene = make_scene(read->record);
    scene.rgb = options.rgb;
    if (Status left_there = leave_scene(scene, options.format, staging, folder / map); !left_there)
      return tl::unexpected(left_there.error());
    left.push_back(folder / map);
    if (options.format != "all") return left;
  }
  if (Status archive = leave_file(staging.path() / name, folder / name); !archive)
    return tl::unexpected(archive.error());
  left.push_back(folder / name);
  return left;
}

/// Exports all maps that can be had: in a backup, one map that fails must not cost the others. If
/// interrupted, it leaves what is whole and nothing hidden.
Status export_maps(AdminClient* client, const Options& options) {
  if (options.rgb && (options.format == "archive" || options.format == "ply"))
    return fail(ErrorCode::kUsage, "--rgb is of images, which --format " + options.format + " has not");
  const Interruption interruption;
  client->stop_when(Interruption::requested);
  std::vector<std::string> maps = options.maps;
  if (maps.empty()) {
    const auto all = client->maps();
    if (!all) return tl::unexpected(all.error());
    for (const json& map : (*all)["maps"]) maps.push_back(map.value("name", ""));
  }
  std::vector<std::filesystem::path> exported;
  std::optional<Error> first;
  size_t whole = 0;
  for (const std::string& map : maps) {
    const auto staging = StagingFolder::make_in(options.folder);
    if (!staging) return tl::unexpected(staging.error());
    const auto paths = export_map(client, options, *staging, map);
    if (paths) {
      exported.insert(exported.end(), paths->begin(), paths->end());
      ++whole;
      continue;
    }
    if (maps.size() > 1) say_error("cairnctl", map + ": not exported: " + paths.error().message);
    if (!first) first = paths.error();
    if (first->code == ErrorCode::kNoServer || Interruption::requested()) break;
  }
  json as_json = json::array();
  for (const auto& path : exported) as_json.push_back(path_in_json(path));
  print(options, as_json, [&exported] {
    for (const auto& path : exported) std::printf("%s\n", one_line(path.string()).c_str());
  });
  if (!first) return {};
  if (maps.size() > 1)
    first->message = std::to_string(whole) + " of " + std::to_string(maps.size()) + " maps exported";
  return tl::unexpected(*first);
}

Status purge_maps(AdminClient* client, const Options& options) {
  std::string which;
  for (const std::string& map : options.maps) which += (which.empty() ? "'" : ", '") + map + "'";
  const Status meant = confirm(options.yes, "Remove what is deleted for good: " + which + "?");
  if (!meant) return meant;
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
class WholeLine : public OwnFooter {
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
void describe(CLI::App* app, Options* options, Action* action, AccessAction* access) {
  app->footer(kFooter);
  app->formatter(std::make_shared<WholeLine>());
  app->require_subcommand(1);
  app->fallthrough();
  app->add_option("--server", options->connection.server, "host of cairn-server")->capture_default_str();
  app->add_option("--domain", options->connection.domain, "DDS domain, 0 to 230")->capture_default_str();
  app->add_option("--profile", options->connection.profile,
                  "network [loopback for localhost, wifi otherwise]");
  app->add_option("--listen", options->connection.listen,
                  "network interface or address of this machine [that of the route to the server]")
      ->type_name("IFACE|ADDR");
  app->add_option("--security", options->connection.security, wire::kSecurityHelp)->type_name("DIR");
  app->add_flag("--json", options->as_json, "for machines");
  app->set_version_flag("--version", "cairnctl " + std::string(version()));

  app->add_subcommand("status", "how the server is, and what of its limits is used")->callback([action] {
    *action = show_status;
  });
  app->add_subcommand("rigs", "what rigs do, who commands them, what was ordered last, what is in their way")
      ->callback([action] { *action = list_rigs; });
  CLI::App* maps = app->add_subcommand("maps", "all maps; without a word more, lists them");
  maps->callback([action, access] {
    if (!*action && !*access) *action = list_maps;
  });
  describe_drop_from_all(maps, access);
  maps->add_subcommand(
          "list",
          "name, id, size, which other maps it overlaps; deleted ones; files set aside as damaged or not "
          "loaded, and why")
      ->callback([action] { *action = list_maps; });
  CLI::App* out = maps->add_subcommand("export", "maps into files");
  out->add_option("MAP", options->maps, "names or ids [all]")->check(fault_of_word);
  out->add_option("--out", options->folder, "folder")->capture_default_str();
  out->add_option("--format", options->format,
                  "archive can be imported again; the others, for other programs, go into a folder of the "
                  "map's name. An earlier export there is replaced, other files are not")
      ->check(CLI::IsMember({"archive", "colmap", "colmap-text", "ply", "all"}))
      ->capture_default_str();
  out->add_flag("--rgb", options->rgb,
                "images of three equal channels, for programs that insist on RGB (the map's are grey)");
  out->footer(kExportFooter);
  out->callback([action] { *action = export_maps; });
  CLI::App* in = maps->add_subcommand("import", "archives into the server");
  in->add_option("FILE", options->files, "archives")->required();
  in->callback([action] { *action = import_maps; });
  CLI::App* purge = maps->add_subcommand("purge", "removes deleted maps for good");
  purge->add_option("MAP", options->maps, "names or ids of deleted maps")->required()->check(fault_of_word);
  add_yes(purge, &options->yes);
  purge->callback([action] { *action = purge_maps; });

  CLI::App* map = app->add_subcommand("map", "one map");
  map->add_option("MAP", options->map, "its name or id")->required()->check(fault_of_word);
  map->require_subcommand(1);
  const auto add = [&](const char* word, const char* help, const char* verb) {
    CLI::App* sub = map->add_subcommand(word, help);
    sub->callback([action, verb] {
      *action = [verb](AdminClient* client, const Options& o) {
        if (o.for_good) {
          const Status meant = confirm(o.yes, "Delete map '" + o.map + "' for good? It cannot be had back.");
          if (!meant) return meant;
        }
        return change_map(client, o, {{"verb", verb}, {"name", o.new_name}, {"for_good", o.for_good}});
      };
    });
    return sub;
  };
  add("show", "what it is: size, epoch, plane, reprojection error, cameras, labels", "show");
  add("rename", "calls it otherwise", "rename")
      ->add_option("NAME", options->new_name, "a-z, 0-9 and -")
      ->required()
      ->check(fault_of_word);
  CLI::App* gone = add("delete", "takes it out of service; with --store it can be had back", "delete");
  gone->add_flag("--for-good", options->for_good, "from a server without --store, where it cannot");
  add_yes(gone, &options->yes);
  add("undelete", "puts it back into service", "undelete");
  describe_freeze(map, &options->map, access);
  describe_extent(map, &options->map, access);
  describe_versions(map, &options->map, access);
}

std::string check_label_id(const std::string& text) {
  const bool is_number =
      !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
  return is_number ? "" : "'" + text + "' is not the id of a label; `cairnctl labels` lists them";
}

void describe_labels(CLI::App* app, Options* options, Action* action) {
  CLI::App* labels =
      app->add_subcommand("labels", "what people have said of places; without a word more, lists it");
  labels->add_option("MAP", options->map, "name or id [all maps]")->check(fault_of_word);
  labels->callback([action] {
    if (!*action) *action = list_labels;
  });
  labels->add_subcommand("list", "map, id, text, author, time, place [m]")->callback([action] {
    *action = list_labels;
  });
  CLI::App* rename = labels->add_subcommand("rename", "says something else there");
  rename->add_option("LABEL", options->label, "its id")->required()->check(check_label_id);
  rename->add_option("TEXT", options->text, "one line of UTF-8, at most 256 bytes")
      ->required()
      ->check(fault_of_word);
  rename->callback([action] {
    *action = [](AdminClient* client, const Options& o) {
      return change_label(client, o, {{"verb", "label-rename"}, {"text", o.text}});
    };
  });
  CLI::App* remove = labels->add_subcommand("remove", "says nothing any more there");
  remove->add_option("LABEL", options->label, "its id")->required()->check(check_label_id);
  add_yes(remove, &options->yes);
  remove->callback([action] {
    *action = [](AdminClient* client, const Options& o) -> Status {
      const std::string which = "label " + std::to_string(o.label) + " of map '" + o.map + "'";
      const Status meant = o.map.empty() ? Status() : confirm(o.yes, "Remove " + which + " for good?");
      return meant ? change_label(client, o, {{"verb", "label-remove"}}) : meant;
    };
  });
}

int run(int argc, char** argv) {
  CLI::App app("Looks after the maps of a cairn-server and what is written in them.", "cairnctl");
  Options options;
  Action action;
  AccessAction access;
  describe(&app, &options, &action, &access);
  describe_access(&app, &access);
  describe_labels(&app, &options, &action);
  RigAction rig_action;
  describe_rig(&app, &rig_action);
  LocalAction local_action;
  describe_keys(&app, &local_action);
  describe_store(&app, &access, &local_action);
  describe_proposals(&app, &access);
  describe_watch(&app, &access);
  describe_doctor(&app, &options.connection, &local_action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return end_of_parse(app, error);
  }
  if (access) action = [access](AdminClient* client, const Options& o) { return access(client, o.as_json); };
  std::signal(SIGXFSZ, SIG_IGN);  // a file at its limit is an error of that write
  const Logger log = make_logger("cairnctl");
  const wire::LogRedirect middleware_log(log);
  Result<AdminClient> client = fail(ErrorCode::kInternal, "not connected");
  Status done;
  if (local_action) {
    done = local_action(options.as_json);
  } else if (rig_action) {
    const AdminClientOptions& network = options.connection;
    done = rig_action({"", "", network.domain, network.profile, network.listen, network.security},
                      options.as_json);
  } else {
    client = AdminClient::connect(options.connection);
    done = client ? action(&*client, options) : tl::unexpected(client.error());
  }
  if (std::fflush(stdout) != 0 && done)
    done = fail(ErrorCode::kIo, std::string("standard output: cannot be written: ") + std::strerror(errno));
  if (!done) say_error("cairnctl", done.error().message);
  const int code = done ? 0 : Interruption::requested() ? kInterruptedExit : exit_code(done.error().code);
  const ExitDeadline deadline(code, kClosingPatience, log);
  client = fail(ErrorCode::kInternal, "closed");
  return code;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  try {
    return cairn::run(argc, argv);
  } catch (const nlohmann::json::exception& error) {
    cairn::say_error("cairnctl", std::string("the server's answer is not understood (") + error.what() +
                                     "); is it of another version?");
    return cairn::exit_code(cairn::ErrorCode::kDamaged);
  } catch (const std::exception& error) {
    cairn::say_error("cairnctl", std::string("internal error: ") + error.what());
    return 1;
  }
}
