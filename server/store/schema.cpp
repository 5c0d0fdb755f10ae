// SPDX-License-Identifier: Apache-2.0
#include "server/store/schema.h"

#include <algorithm>
#include <array>
#include <string>

namespace cairn {
namespace {

// Steps that have been released are never edited: files of their version exist.
constexpr std::array kMapSteps{
    "CREATE TABLE map(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE epochs(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE cameras(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE keyframes(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE images(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE measurements(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE sources(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE positions(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE decisions(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
    "CREATE TABLE labels(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
    "CREATE TABLE found_cameras(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) "
    "STRICT;",
    "",  // a keyframe may say what stands still in its image
    "",  // and which way was up
    "CREATE TABLE tags(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE kept(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
    "CREATE TABLE proposals(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE proposal_pictures(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) "
    "STRICT;",
    "CREATE TABLE contributors(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) "
    "STRICT;",  // and a tag says in which epoch it was made
    "",         // work that is due may be bounded by an extent
    "",         // a keyframe may be of a client that adds only
};
constexpr std::array kCatalogueSteps{
    "CREATE TABLE server(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
    "CREATE TABLE overlaps(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
};
constexpr std::array kSiteSteps{
    "CREATE TABLE rights(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;"
    "CREATE TABLE audit(number INTEGER PRIMARY KEY, time INTEGER NOT NULL, who TEXT NOT NULL, "
    "action TEXT NOT NULL, object TEXT NOT NULL, outcome TEXT NOT NULL) STRICT;",
    "CREATE TABLE secured(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
    "CREATE TABLE authority(id INTEGER PRIMARY KEY, data BLOB NOT NULL, checksum INTEGER NOT NULL) STRICT;",
};

constexpr int32_t kMapApplication = 0x4361694D;        // CaiM
constexpr int32_t kCatalogueApplication = 0x43616943;  // CaiC
constexpr int32_t kSiteApplication = 0x43616953;       // CaiS

}  // namespace

const Schema& map_schema() {
  static const Schema schema{kMapApplication, kMapSteps};
  return schema;
}

const Schema& catalogue_schema() {
  static const Schema schema{kCatalogueApplication, kCatalogueSteps};
  return schema;
}

const Schema& site_schema() {
  static const Schema schema{kSiteApplication, kSiteSteps};
  return schema;
}

Result<int> schema_version(sqlite::Database* database, const Schema& schema) {
  const auto version = database->number("PRAGMA user_version");
  if (!version) return tl::unexpected(version.error());
  const auto application = database->number("PRAGMA application_id");
  if (!application) return tl::unexpected(application.error());
  const auto tables = database->number("SELECT count(*) FROM sqlite_schema");
  if (!tables) return tl::unexpected(tables.error());
  if (*tables == 0 && *version == 0) return 0;
  if (*application != schema.application_id || *version < 1) {
    return fail(ErrorCode::kDamaged, database->path() + ": not a file of this program");
  }
  if (*version > static_cast<int64_t>(schema.steps.size())) {
    return fail(ErrorCode::kConfiguration,
                database->path() + ": written by a newer version (schema " + std::to_string(*version) +
                    ", known up to " + std::to_string(schema.steps.size()) + "); install that version");
  }
  return static_cast<int>(*version);
}

Status check_schema(sqlite::Database* database, const Schema& schema, int version) {
  std::string expected;
  for (const char* step : schema.steps.first(static_cast<size_t>(version))) expected += step;
  auto query = database->prepare("SELECT sql FROM sqlite_schema");
  if (!query) return tl::unexpected(query.error());
  size_t found = 0;
  while (true) {
    const auto row = query->step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    const std::string sql = query->text(0) + ";";  // SQLite keeps the words of CREATE
    if (!expected.starts_with(sql) && expected.find(";" + sql) == std::string::npos)
      return fail(ErrorCode::kDamaged,
                  database->path() + ": holds what no such file has: " + sql.substr(0, 60));
    ++found;
  }
  if (found != static_cast<size_t>(std::count(expected.begin(), expected.end(), ';')))
    return fail(ErrorCode::kDamaged, database->path() + ": a table is missing");
  auto check = database->prepare("PRAGMA quick_check(1)");
  if (!check) return tl::unexpected(check.error());
  const auto row = check->step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || check->text(0) != "ok")
    return fail(ErrorCode::kDamaged, database->path() + ": " + check->text(0));
  return {};
}

Status migrate(sqlite::Database* database, const Schema& schema, int version, int target) {
  for (int v = version; v < target; ++v) {
    if (Status done = database->execute(schema.steps[static_cast<size_t>(v)]); !done) return done;
  }
  return database->execute("PRAGMA application_id=" + std::to_string(schema.application_id) +
                           "; PRAGMA user_version=" + std::to_string(target));
}

}  // namespace cairn
