// SPDX-License-Identifier: Apache-2.0
#include "server/store/store_check.h"

#include <algorithm>
#include <chrono>
#include <tuple>

#include "server/mapping/map_record.h"
#include "server/store/backup.h"
#include "server/store/bytes.h"
#include "server/store/database_files.h"
#include "server/store/entry_codec.h"
#include "server/store/map_file.h"
#include "server/store/rows.h"
#include "server/store/schema.h"
#include "server/store/site_file.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCatalogue = "catalogue.db";
constexpr const char* kSite = "site.db";
constexpr size_t kAuditEntries = 1000;  ///< at a time

constexpr const char* kMapRemedy =
    "a start sets the file aside and serves what can be saved of it; an archive or a backup has it whole: "
    "`cairnctl map NAME delete`, `cairnctl maps purge`, `cairnctl maps import`, or `cairnctl restore`";
constexpr const char* kProposalRemedy =
    "the map is whole without these proposals: `cairnctl proposals drop` those that are listed still, the "
    "next start removes the others; a backup may have them";
constexpr const char* kDeletedRemedy = "`cairnctl maps purge ID` removes it; a backup may have it whole";
constexpr const char* kCatalogueRemedy =
    "a start begins it anew, and clients lose what was not decided yet; no map is lost";
constexpr const char* kSiteRemedy =
    "a start sets it aside, and nobody may do anything until an operator grants it; a backup has the rights";

Status check_database(const fs::path& path, const Schema& schema) {
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
  if (!database) return tl::unexpected(database.error());
  const auto version = schema_version(&*database, schema);
  if (!version) return tl::unexpected(version.error());
  return check_schema(&*database, schema, *version);
}

/// Notes an error as a fault, or as the reason why the file was not checked: that the disk is full or may not
/// be written says nothing of what is in the file.
void note(const Error& error, FileCheck* found) {
  error.code == ErrorCode::kIo ? found->not_checked = error.message
                               : found->faults.emplace_back(error.message);
}

/// Checks what the rows of a map say of each other. Returns what is wrong.
std::vector<std::string> check_references(const StoredMap& map, FileCheck* found) {
  std::vector<std::string> faults;
  if (map.epochs.empty() || map.epochs.back().epoch != map.header.epoch)
    faults.emplace_back("its last epoch is not the one in which it was served last");
  for (const LabelRecord& label : map.labels) {
    if (label.anchor.value > map.record.keyframe_count)
      faults.push_back("label " + std::to_string(label.id) + " sticks to a keyframe that never was");
  }
  const auto assembled = assemble_map(map.record, RestoredImages::kEvicted);
  if (!assembled) {
    faults.push_back(assembled.error().message);
    return faults;
  }
  faults.insert(faults.end(), assembled->repairs.begin(), assembled->repairs.end());
  found->keyframes = assembled->state.live_keyframes();
  found->points = assembled->state.live_point_ids().size();
  return faults;
}

void check_map(const fs::path& path, FileInUse in_use, FileCheck* found) {
  auto file = MapFile::open(path, FileOrigin::kElsewhere, in_use);
  if (!file) return note(file.error(), found);
  const auto as_of_now = file->read_as_of_now();
  if (!as_of_now) return note(as_of_now.error(), found);
  const StoredMap map = file->load(LoadedImages::kDecodedOnly);
  found->name = map.header.name;
  found->labels = map.labels.size();
  found->tags = file->tags().value_or(std::vector<MapTag>()).size();
  std::vector<std::string> faults = map.damage;
  for (const auto& more : {file->check_tags(), check_references(map, found)})
    faults.insert(faults.end(), more.begin(), more.end());
  if (path.stem() != to_hex(map.header.id.bytes))
    faults.push_back("it is the file of another map, " + to_hex(map.header.id.bytes));
  for (const std::string& fault : faults) found->faults.push_back(path.string() + ": " + fault);
  for (const auto& lost : {map.lost_proposals, file->check_proposals()})
    for (const std::string& row : lost) found->lost_proposals.push_back(path.string() + ": " + row);
}

void check_catalogue(const fs::path& path, FileCheck* found) {
  if (Status sound = check_database(path, catalogue_schema()); !sound) return note(sound.error(), found);
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
  if (!database) return note(database.error(), found);
  std::vector<std::string> damage;
  read_rows(
      &*database, "server",
      [](int64_t, std::span<const uint8_t> data) {
        ByteReader in(data);
        ServerId server;
        in.get(std::span(server.bytes));
        (void)in.get<uint64_t>();
        return in.finished();
      },
      &damage);
  read_rows(
      &*database, "overlaps",
      [](int64_t, std::span<const uint8_t> data) { return decode_overlap(data).has_value(); }, &damage);
  for (const std::string& row : damage) found->faults.push_back(path.string() + ": " + row);
}

void check_site(const fs::path& path, const CheckRights& rights, FileCheck* found) {
  if (Status sound = check_database(path, site_schema()); !sound) return note(sound.error(), found);
  auto file = SiteFile::open(path);
  if (!file) return note(file.error(), found);
  const auto text = file->rights();
  Status sound = text ? Status() : tl::unexpected(text.error());
  if (sound && *text && rights) sound = rights(**text);
  if (sound) {
    const auto since = file->secured_since();
    if (!since) sound = tl::unexpected(since.error());
  }
  AuditQuery page;
  page.limit = kAuditEntries;
  while (sound) {
    const auto entries = file->find(page);
    if (!entries) sound = tl::unexpected(entries.error());
    if (!entries || entries->empty()) break;
    page.before_number = entries->back().number;
  }
  if (!sound) note({sound.error().code, path.string() + ": " + sound.error().message}, found);
}

}  // namespace

FileCheck check_part(const fs::path& folder, const std::string& part, const CheckRights& rights,
                     FileInUse in_use) {
  FileCheck found;
  found.part = part;
  const fs::path path = folder / part;
  if (!is_backup_part(part)) {
    found.faults.push_back("'" + part + "' is no file of a store");
  } else if (!is_there(path)) {
    found.faults.push_back(path.string() + ": is not there");
  } else if (part == kCatalogue) {
    check_catalogue(path, &found);
    found.remedy = kCatalogueRemedy;
  } else if (part == kSite) {
    check_site(path, rights, &found);
    found.remedy = kSiteRemedy;
  } else {
    check_map(path, in_use, &found);
    found.remedy = part.starts_with("deleted/") ? kDeletedRemedy : kMapRemedy;
  }
  // Neither of what that says reaches a deleted map.
  if (found.faults.empty() && !part.starts_with("deleted/")) found.remedy = kProposalRemedy;
  if (found.faults.empty() && found.lost_proposals.empty()) found.remedy.clear();
  return found;
}

bool comes_later(const std::string& part, const std::string& than) {
  const auto place = [](const std::string& name) {
    return name.starts_with("maps/") ? 0 : name.starts_with("deleted/") ? 1 : name == kCatalogue ? 2 : 3;
  };
  return std::tuple(place(part), part) > std::tuple(place(than), than);
}

Result<std::vector<std::string>> parts_of_store(const fs::path& folder) {
  std::vector<std::string> parts;
  for (const char* below : {"maps", "deleted"}) {
    if (!is_there(folder / below)) continue;
    const auto entries = entries_of(folder / below);
    if (!entries) return tl::unexpected(entries.error());
    std::vector<std::string> names;
    for (const fs::path& entry : *entries) {
      std::string name = std::string(below) + "/" + entry.filename().string();
      if (is_backup_part(name)) names.push_back(std::move(name));
    }
    std::sort(names.begin(), names.end());
    parts.insert(parts.end(), names.begin(), names.end());
  }
  for (const char* name : {kCatalogue, kSite}) {
    if (is_there(folder / name)) parts.emplace_back(name);
  }
  return parts;
}

Status copy_part(const fs::path& folder, const std::string& part, const fs::path& to) {
  if (!is_backup_part(part)) return fail(ErrorCode::kUsage, "'" + part + "' is no file of a store");
  const fs::path path = folder / part;
  if (!is_there(path)) return fail(ErrorCode::kNotFound, path.string() + ": is not there");
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
  return database ? database->copy_to(to) : tl::unexpected(database.error());
}

Status settle_restored(const fs::path& unpacked, const fs::path& folder, const CheckRights& rights,
                       const std::string& who) {
  const auto parts = parts_of_store(unpacked);
  if (!parts) return tl::unexpected(parts.error());
  if (Status all = check_is_all(*parts); !all) return all;
  for (const std::string& part : *parts) {
    const FileCheck check = check_part(unpacked, part, rights);
    if (!check.faults.empty()) return fail(ErrorCode::kDamaged, check.faults.front());
  }
  {
    auto site = SiteFile::open(unpacked / kSite);
    if (!site) return tl::unexpected(site.error());
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    const AuditEntry entry{0,
                           {std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()},
                           who,
                           "restore",
                           folder.string(),
                           "done"};
    if (Status noted = site->append({&entry, 1}); !noted) return noted;
  }
  for (const char* below : {"maps", "deleted"}) {
    if (is_there(unpacked / below)) sync_folder(unpacked / below);
  }
  sync_folder(unpacked);
  std::error_code problem;
  fs::permissions(unpacked, fs::perms::owner_all | fs::perms::group_read | fs::perms::group_exec, problem);
  if (!problem) fs::rename(unpacked, folder, problem);
  if (problem) return io_failure(folder, "cannot be made of what was unpacked: " + problem.message());
  sync_folder(folder.parent_path());
  return {};
}

}  // namespace cairn
