// SPDX-License-Identifier: Apache-2.0
#include "server/admin/store_commands.h"

#include <unistd.h>

#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/base/version.h"
#include "common/io/json_text.h"
#include "common/io/text.h"
#include "server/access/rights_file.h"
#include "server/admin/export_folder.h"
#include "server/admin/interruption.h"
#include "server/admin/listing.h"
#include "server/admin/own_name.h"
#include "server/store/backup.h"
#include "server/store/check_report.h"
#include "server/store/site_file.h"

namespace cairn {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr const char* kFooter =
    "Examples:\n"
    "  cairnctl backup /var/backups/cairn-$(date +%F).tar      while the server runs\n"
    "  cairnctl verify --backup /var/backups/cairn-2027-01-31.tar\n"
    "  cairnctl restore /var/backups/cairn-2027-01-31.tar --data /var/lib/cairn/store\n"
    "                                                          as the server's user, then start the server\n"
    "  cairnctl verify                                         the store of a server that runs\n"
    "  cairnctl verify --data /var/lib/cairn/store             a store without its server";

struct Words {
  std::string file;
  std::string data;
  std::string backup;
};

Timestamp wall_clock() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()};
}

/// Shows progress on stderr, on a terminal only.
void show_progress(const std::string& what, uint64_t done, uint64_t of, const char* unit) {
  if (isatty(STDERR_FILENO) != 0)
    std::fprintf(stderr, "\r\033[K%s: %" PRIu64 " of %" PRIu64 " %s%s", one_line(what).c_str(), done, of,
                 unit, done == of ? "\n" : "");
}

Status check_rights(const std::string& text) {
  const auto rights = read_rights(text);
  return rights ? Status() : tl::unexpected(rights.error());
}

/// Names of all parts of the store that the request `verb` lists, page by page.
Result<std::vector<std::string>> list_parts(AdminClient* client, const char* verb) {
  std::vector<std::string> parts;
  while (true) {
    const auto page = client->ask({{"verb", verb}, {"after", parts.empty() ? "" : parts.back()}});
    if (!page) return tl::unexpected(page.error());
    const size_t before = parts.size();
    for (const json& part : page->content.value("parts", json::array()))
      if (part.is_string()) parts.push_back(part.get<std::string>());
    if (!page->content.value("more", false)) return parts;
    if (parts.size() == before)
      return fail(ErrorCode::kInternal, "the server says that there are more files, and names none");
  }
}

/// A map that was deleted or put back since the files were listed lies elsewhere now.
std::optional<std::string> other_place(const std::string& part) {
  if (part.starts_with("maps/")) return "deleted/" + part.substr(5);
  if (part.starts_with("deleted/")) return "maps/" + part.substr(8);
  return std::nullopt;
}

/// Id of the map whose file a part is, in whichever folder of the store it lies.
std::string id_of(const std::string& part) {
  return fs::path(part).stem().string();
}

/// Downloads a part and adds it to the backup. False: it is not there any more (moved, or purged).
Result<bool> take_part(AdminClient* client, const std::string& part, const fs::path& copy,
                       BackupWriter* writer) {
  const auto got =
      client->download(json{{"verb", "backup-part"}, {"part", part}}, copy, [](uint64_t, uint64_t) {});
  if (!got) return fail(got.error().code, part + ": " + got.error().message);
  if (got->value("gone", false)) return false;
  Status added = writer->add(part, copy);
  std::error_code ignored;
  fs::remove(copy, ignored);
  if (!added) return tl::unexpected(added.error());
  return true;
}

Status take_parts(AdminClient* client, const fs::path& staging, BackupWriter* writer) {
  const auto parts = list_parts(client, "backup");
  if (!parts) return tl::unexpected(parts.error());
  std::set<std::string> ids;
  for (size_t i = 0; i < parts->size(); ++i) {
    show_progress("backup", i, parts->size(), "files");
    if (ids.contains(id_of((*parts)[i]))) continue;  // moved while the pages of the list came
    auto taken = take_part(client, (*parts)[i], staging / "part", writer);
    const auto other = other_place((*parts)[i]);
    if (taken && !*taken && other) taken = take_part(client, *other, staging / "part", writer);
    if (!taken) return tl::unexpected(taken.error());
    if (*taken) ids.insert(id_of((*parts)[i]));
  }
  show_progress("backup", parts->size(), parts->size(), "files");
  return {};
}

/// A name that was mistyped makes no folder.
Status check_folder_of(const fs::path& place) {
  const fs::path folder = place.parent_path();
  std::error_code problem;
  if (fs::is_directory(folder, problem)) return {};
  return fail(ErrorCode::kIo, in_quotes(folder.string()) +
                                  ": there is no such folder; name another, or `mkdir -p " +
                                  one_line(folder.string()) + "` makes it");
}

/// Backs up all of the store into a file. If that fails, no file of that name is left.
Status back_up(AdminClient* client, const std::string& file, bool as_json) {
  const Interruption interruption;
  client->stop_when(Interruption::requested);
  const fs::path place = fs::absolute(file);
  std::error_code ignored;
  if (fs::exists(fs::symlink_status(place, ignored))) {
    return fail(ErrorCode::kRefused,
                in_quotes(file) + ": is there already, and a backup replaces nothing; choose another name");
  }
  if (Status there = check_folder_of(place); !there) return there;
  const auto staging = StagingFolder::make_in(place.parent_path());
  if (!staging) return tl::unexpected(staging.error());
  const fs::path made = staging->path() / place.filename();
  auto writer = BackupWriter::create(made);
  Status done = writer ? take_parts(client, staging->path(), &*writer) : tl::unexpected(writer.error());
  if (done) done = writer->finish(wall_clock(), std::string(version()));
  if (done) done = leave_file(made, place);
  if (!done) return tl::unexpected(staging->told_of(place.parent_path(), done.error()));
  std::fprintf(
      stderr,
      "cairnctl: the backup has maps, labels, tags, rights and the audit log. It has neither keys (the "
      "folder of the site's keys, security folders) nor the server's configuration and wearers files: "
      "keep these elsewhere\n");
  const json told{{"file", path_in_json(place)},
                  {"files", writer->content().parts.size()},
                  {"bytes", fs::file_size(place, ignored)}};
  if (as_json) {
    std::printf("%s\n", json_text(told, 2).c_str());
  } else {
    std::printf("%s: %zu files, %.1f MB\n", one_line(place.string()).c_str(), writer->content().parts.size(),
                told.value("bytes", 0.0) * 1e-6);
  }
  return {};
}

/// A folder that is not there, or has nothing in it.
Status check_is_free(const fs::path& folder) {
  std::error_code problem;
  const auto status = fs::symlink_status(folder, problem);
  if (!fs::exists(status)) return {};
  const bool is_empty = fs::is_directory(status) && fs::is_empty(folder, problem);
  if (is_empty && !problem) return {};
  return fail(ErrorCode::kRefused,
              in_quotes(folder.string()) +
                  ": is not empty, and a restore replaces nothing; stop the server and move "
                  "that away, or name another folder");
}

Result<BackupContent> unpack(const std::string& backup, const fs::path& unpacked) {
  return read_backup(backup, unpacked, [](uint64_t done, uint64_t of) {
    show_progress("reading", done >> 20, of >> 20, "MB");
  });
}

/// Whether only who has keys takes part there.
Result<bool> is_secured(const fs::path& store) {
  std::error_code ignored;
  if (!fs::exists(store / "site.db", ignored)) return false;
  auto site = SiteFile::open(store / "site.db");
  if (!site) return tl::unexpected(site.error());
  const auto since = site->secured_since();
  if (!since) return tl::unexpected(since.error());
  return since->has_value();
}

/// Prints how a server is started with what was restored.
void print_next_step(const fs::path& folder, bool needs_keys) {
  const std::string store = one_line(folder.string());
  if (!needs_keys) {
    std::printf("start the server with `cairn-server --store %s`\n", store.c_str());
    return;
  }
  std::printf(
      "start the server with `cairn-server --store %s --security DIR`: it is a secured site's, and a backup "
      "has no keys. DIR is a copy of the security folder that its server had "
      "(`cairn-keys/enclaves/server/NAME` where the site's keys are), not one of a new `cairnctl keys init` "
      "(deploy/SECURED.md, On another machine)\n",
      store.c_str());
}

Status restore(const std::string& backup, const std::string& data, bool as_json) {
  fs::path folder = fs::absolute(data).lexically_normal();
  if (!folder.has_filename())
    folder = folder.parent_path();  // it was named with a slash at its end, or as "."
  if (Status is_free = check_is_free(folder); !is_free) return is_free;
  if (Status there = check_folder_of(folder); !there) return there;
  // Beside the folder, so that a half of it is never taken for a store.
  const auto staging = StagingFolder::make_in(folder.parent_path());
  if (!staging) return tl::unexpected(staging.error());
  const fs::path unpacked = staging->path() / folder.filename();
  const auto content = unpack(backup, unpacked);
  const Status done = content ? settle_restored(unpacked, folder, check_rights, "operator " + person_name())
                              : tl::unexpected(content.error());
  if (!done) return tl::unexpected(staging->told_of(folder.parent_path(), done.error()));
  const auto needs_keys = is_secured(folder);
  if (!needs_keys) return tl::unexpected(needs_keys.error());
  const json told{{"data", path_in_json(folder)},
                  {"made", to_utc(content->made)},
                  {"files", content->parts.size()},
                  {"secured", *needs_keys}};
  if (as_json) {
    std::printf("%s\n", json_text(told, 2).c_str());
  } else {
    std::printf("%s: %zu files of the backup of %s\n", one_line(folder.string()).c_str(),
                content->parts.size(), to_utc(content->made).c_str());
    print_next_step(folder, *needs_keys);
  }
  return {};
}

void print_check(const json& check) {
  const json faults = check.value("faults", json::array());
  const std::string name = text_of(check, "name");
  const std::string not_checked = text_of(check, "not_checked");
  std::printf("%s%s%s: %s", text_of(check, "part").c_str(), name.empty() ? "" : "  ", name.c_str(),
              !faults.empty()       ? "damaged"
              : not_checked.empty() ? "sound"
                                    : ("not checked: " + not_checked).c_str());
  if (faults.empty() && not_checked.empty() && text_of(check, "part").ends_with(".cairnmap"))
    std::printf(", %" PRIu64 " keyframes, %" PRIu64 " points, %" PRIu64 " labels, %" PRIu64 " tags",
                count_of(check, "keyframes"), count_of(check, "points"), count_of(check, "labels"),
                count_of(check, "tags"));
  std::printf("\n");
  for (const json& fault : faults) std::printf("    %s\n", one_line(fault.get<std::string>()).c_str());
  if (!faults.empty()) std::printf("    remedy: %s\n", text_of(check, "remedy").c_str());
}

/// Prints what was found; error kDamaged when anything was, kIo when anything could not be checked.
Status tell_checks(const json& checks, bool as_json) {
  size_t damaged = 0;
  size_t not_checked = 0;
  for (const json& check : checks) {
    damaged += check.value("faults", json::array()).empty() ? 0 : 1;
    not_checked += text_of(check, "not_checked").empty() ? 0 : 1;
  }
  if (as_json) {
    std::printf("%s\n", json_text(checks, 2).c_str());
  } else {
    for (const json& check : checks) print_check(check);
  }
  const std::string of_all = " of " + std::to_string(checks.size()) + " files ";
  if (damaged > 0) return fail(ErrorCode::kDamaged, std::to_string(damaged) + of_all + "are damaged");
  if (not_checked > 0)
    return fail(ErrorCode::kIo,
                std::to_string(not_checked) + of_all + "could not be checked; see to the disk");
  return {};
}

Status verify_server(AdminClient* client, bool as_json) {
  const auto parts = list_parts(client, "verify");
  if (!parts) return tl::unexpected(parts.error());
  json checks = json::array();
  for (const std::string& part : *parts) {
    show_progress("verify", checks.size(), parts->size(), "files");
    const auto check = client->ask({{"verb", "verify-part"}, {"part", part}});
    if (!check) return tl::unexpected(check.error());
    if (!check->content.value("gone", false)) checks.push_back(check->content);
  }
  show_progress("verify", parts->size(), parts->size(), "files");
  return tell_checks(checks, as_json);
}

Result<json> check_folder(const fs::path& folder) {
  const auto parts = parts_of_store(folder);
  if (!parts) return tl::unexpected(parts.error());
  if (parts->empty())
    return fail(ErrorCode::kNotFound, in_quotes(folder.string()) + ": no store is there (maps/, site.db)");
  json checks = json::array();
  for (const std::string& part : *parts) {
    show_progress("verify", checks.size(), parts->size(), "files");
    checks.push_back(describe(check_part(folder, part, check_rights)));
  }
  show_progress("verify", parts->size(), parts->size(), "files");
  return checks;
}

Status verify_folder(const std::string& data, bool as_json) {
  const auto checks = check_folder(data);
  return checks ? tell_checks(*checks, as_json) : tl::unexpected(checks.error());
}

Status verify_backup(const std::string& backup, bool as_json) {
  const fs::path place = fs::absolute(backup);
  if (Status there = check_folder_of(place); !there) return there;
  const auto staging = StagingFolder::make_in(place.parent_path());
  if (!staging) return tl::unexpected(staging.error());
  const auto content = unpack(backup, staging->path() / "store");
  if (!content) return tl::unexpected(content.error());
  const auto checks = check_folder(staging->path() / "store");
  return checks ? tell_checks(*checks, as_json) : tl::unexpected(checks.error());
}

}  // namespace

void describe_store(CLI::App* app, AccessAction* action, LocalAction* local) {
  const auto words = std::make_shared<Words>();
  CLI::App* out = app->add_subcommand(
      "backup",
      "all maps, deleted ones too, with labels, tags, rights and audit log into one file, while the "
      "server runs. It holds images: its owner only may read it. It holds no keys and no configuration");
  out->add_option("FILE", words->file, "that is not there yet; `tar tf` lists it")->required();
  out->footer(kFooter);
  out->callback([action, words] {
    *action = [words](AdminClient* client, bool as_json) { return back_up(client, words->file, as_json); };
  });
  CLI::App* in = app->add_subcommand(
      "restore", "a store of a backup, without a server; nothing is there unless all of it is sound");
  in->add_option("FILE", words->file, "of `cairnctl backup`")->required();
  in->add_option("--data", words->data, "folder for `cairn-server --store`, not there or empty")
      ->required()
      ->type_name("FOLDER");
  in->footer(kFooter);
  in->callback([local, words] {
    *local = [words](bool as_json) { return restore(words->file, words->data, as_json); };
  });
  CLI::App* check = app->add_subcommand(
      "verify",
      "reads every row and every image of the server's store and says what is damaged and what to "
      "do; exit code 6 if anything is");
  CLI::Option* data =
      check->add_option("--data", words->data, "a store here instead, with or without its server")
          ->type_name("FOLDER");
  check->add_option("--backup", words->backup, "a backup instead; it is unpacked beside it for a while")
      ->type_name("FILE")
      ->excludes(data);
  check->footer(kFooter);
  check->callback([action, local, words] {
    if (!words->data.empty()) {
      *local = [words](bool as_json) { return verify_folder(words->data, as_json); };
    } else if (!words->backup.empty()) {
      *local = [words](bool as_json) { return verify_backup(words->backup, as_json); };
    } else {
      *action = [](AdminClient* client, bool as_json) { return verify_server(client, as_json); };
    }
  });
}

}  // namespace cairn
