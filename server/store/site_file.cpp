// SPDX-License-Identifier: Apache-2.0
#include "server/store/site_file.h"

#include <fmt/format.h>

#include <functional>
#include <limits>
#include <numeric>
#include <utility>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "server/store/rows.h"
#include "server/store/schema.h"

namespace cairn {
namespace {

constexpr int64_t kOnlyRow = 1;      // of the tables that hold one value
constexpr size_t kMostWords = 1000;  ///< [bytes] of a part of an entry: a page of the audit log holds some

/// Whatever an operator has asked for, one line of it.
std::string kept_words(std::string_view text) {
  return std::string(cut_text(one_line(text), kMostWords));
}

/// Escapes a text so that it stands for itself in LIKE ... ESCAPE '\'.
std::string escaped(std::string_view text) {
  std::string pattern;
  for (const char c : text) {
    if (c == '%' || c == '_' || c == '\\') pattern += '\\';
    pattern += c;
  }
  return pattern;
}

AuditEntry entry_of(const sqlite::Statement& row) {
  return {row.integer(0), {row.integer(1)}, row.text(2), row.text(3), row.text(4), row.text(5)};
}

/// Most entries that each keeps so that all have room together: who has fewer keeps all (max-min fairness).
/// `counts`: entries of each, by rising number.
int64_t fair_share(const std::vector<std::pair<std::string, int64_t>>& counts, int64_t room) {
  auto left = static_cast<int64_t>(counts.size());
  for (const auto& [who, entries] : counts) {
    if (entries * left > room) return room / left;
    room -= entries;
    --left;
  }
  return std::numeric_limits<int64_t>::max();
}

}  // namespace

Result<SiteFile> SiteFile::open(const std::filesystem::path& path) {
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kCreate);
  if (!database) return tl::unexpected(database.error());
  const auto version = schema_version(&*database, site_schema());
  if (!version) return tl::unexpected(version.error());
  auto transaction = sqlite::Transaction::begin(&*database);
  if (!transaction) return tl::unexpected(transaction.error());
  const auto newest = static_cast<int>(site_schema().steps.size());
  if (Status done = migrate(&*database, site_schema(), *version, newest); !done)
    return tl::unexpected(done.error());
  if (Status sound = check_schema(&*database, site_schema(), newest); !sound)
    return tl::unexpected(sound.error());
  if (Status done = transaction->commit(); !done) return tl::unexpected(done.error());
  return SiteFile(std::move(*database));
}

Result<std::optional<std::string>> SiteFile::text_in(const char* table) {
  std::optional<std::string> text;
  std::vector<std::string> damage;
  read_rows(
      &database_, table,
      [&](int64_t id, std::span<const uint8_t> data) {
        if (id == kOnlyRow) text = std::string(data.begin(), data.end());
        return id == kOnlyRow;
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + damage.front());
  return text;
}

Status SiteFile::put(const char* table, std::string_view text) {
  auto row = database_.prepare(put_row_sql(table));
  if (!row) return tl::unexpected(row.error());
  const std::span data(reinterpret_cast<const uint8_t*>(text.data()), text.size());
  return row->bind(0, kOnlyRow).bind(1, data).bind(2, row_checksum(kOnlyRow, data)).run();
}

Result<std::optional<std::string>> SiteFile::rights() {
  return text_in("rights");
}

Status SiteFile::keep_rights(std::string_view text, const AuditEntry& entry) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (Status done = put("rights", text); !done) return done;
  if (Status done = insert({&entry, 1}); !done) return done;
  return transaction->commit();
}

Result<std::optional<Timestamp>> SiteFile::secured_since() {
  const auto text = text_in("secured");
  if (!text) return tl::unexpected(text.error());
  if (!*text) return std::nullopt;
  const auto since = parse_utc(**text);
  if (!since)
    return fail(ErrorCode::kDamaged, database_.path() + ": table secured: " + since.error().message);
  return *since;
}

Status SiteFile::keep_secured(std::string_view rights, const AuditEntry& entry) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (Status done = put("secured", to_utc(entry.time)); !done) return done;
  if (Status done = put("rights", rights); !done) return done;
  if (Status done = insert({&entry, 1}); !done) return done;
  return transaction->commit();
}

Result<std::optional<std::string>> SiteFile::authority() {
  return text_in("authority");
}

Status SiteFile::keep_authority(std::string_view fingerprint, const std::optional<AuditEntry>& entry) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (Status done = put("authority", fingerprint); !done) return done;
  if (entry) {
    if (Status done = insert({&*entry, 1}); !done) return done;
  }
  return transaction->commit();
}

Status SiteFile::append(std::span<const AuditEntry> entries) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (Status done = insert(entries); !done) return done;
  return transaction->commit();
}

Status SiteFile::insert(std::span<const AuditEntry> entries) {
  auto row = database_.prepare("INSERT INTO audit(time, who, action, object, outcome) VALUES(?, ?, ?, ?, ?)");
  if (!row) return tl::unexpected(row.error());
  for (const AuditEntry& entry : entries) {
    row->bind(0, entry.time.nanoseconds).bind(1, kept_words(entry.who)).bind(2, kept_words(entry.action));
    row->bind(3, kept_words(entry.object)).bind(4, kept_words(entry.outcome));
    if (Status done = row->run(); !done) return done;
    if (at_most_ < std::numeric_limits<int64_t>::max()) ++at_most_;
  }
  return {};
}

Result<std::vector<AuditEntry>> SiteFile::find(const AuditQuery& query) {
  auto rows = database_.prepare(
      "SELECT number, time, who, action, object, outcome FROM audit WHERE number < ?1 AND time >= ?2 AND "
      "time < ?3 AND (who = ?4 OR who LIKE ?5 ESCAPE '\\') AND action LIKE ?6 ESCAPE '\\' AND object LIKE ?7 "
      "ESCAPE '\\' ORDER BY number DESC LIMIT ?8");
  if (!rows) return tl::unexpected(rows.error());
  constexpr int64_t kEnd = std::numeric_limits<int64_t>::max();
  const std::string last_word = query.who.empty() ? "%" : fmt::format("% {}", escaped(query.who));
  const std::string begins = fmt::format("{}%", escaped(query.action));
  const std::string contains = fmt::format("%{}%", escaped(query.object));
  rows->bind(0, query.before_number.value_or(kEnd));
  rows->bind(1, query.from ? query.from->nanoseconds : std::numeric_limits<int64_t>::min());
  rows->bind(2, query.until ? query.until->nanoseconds : kEnd);
  rows->bind(3, query.who).bind(4, last_word).bind(5, begins).bind(6, contains);
  rows->bind(7, static_cast<int64_t>(query.limit));
  std::vector<AuditEntry> entries;
  while (true) {
    const auto row = rows->step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return entries;
    entries.push_back(entry_of(*rows));
  }
}

Result<int64_t> SiteFile::prune(int64_t most) {
  if (at_most_ <= most) return 0;
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  auto counts = entries_of_each();
  if (!counts) return tl::unexpected(counts.error());
  at_most_ = std::transform_reduce(counts->begin(), counts->end(), int64_t{0}, std::plus<>(),
                                   [](const auto& one) { return one.second; });
  if (at_most_ <= most) return 0;
  int64_t removed = 0;
  const int64_t share = fair_share(*counts, most - most / 100);  // with room for some: counting takes time
  auto remove = database_.prepare(
      "DELETE FROM audit WHERE number IN (SELECT number FROM audit WHERE who = ?1 ORDER BY number LIMIT ?2)");
  if (!remove) return tl::unexpected(remove.error());
  for (const auto& [who, entries] : *counts) {
    if (entries <= share) continue;
    if (Status done = remove->bind(0, who).bind(1, entries - share).run(); !done)
      return tl::unexpected(done.error());
    removed += entries - share;
  }
  if (Status done = transaction->commit(); !done) return tl::unexpected(done.error());
  at_most_ -= removed;
  return removed;
}

Result<std::vector<std::pair<std::string, int64_t>>> SiteFile::entries_of_each() {
  auto rows = database_.prepare("SELECT who, count(*) FROM audit GROUP BY who ORDER BY 2");
  if (!rows) return tl::unexpected(rows.error());
  std::vector<std::pair<std::string, int64_t>> counts;
  while (true) {
    const auto row = rows->step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return counts;
    counts.emplace_back(rows->text(0), rows->integer(1));
  }
}

}  // namespace cairn
