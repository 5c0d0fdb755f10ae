// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "server/store/sqlite.h"

namespace cairn {

/// An act of somebody, done or refused.
struct AuditEntry {
  int64_t number = 0;   ///< from 1, ascending; given by append()
  Timestamp time;       ///< of the wall clock
  std::string who;      ///< "operator ann", "client phone-1", "server"
  std::string action;   ///< "rights grant", "map delete", "connect"
  std::string object;   ///< what it was done to: "map desk 3e6f...", "client phone-1"; may be empty
  std::string outcome;  ///< "done", or why not
  bool operator==(const AuditEntry&) const = default;
};

/// Which entries are asked for; what is not set does not narrow.
struct AuditQuery {
  std::string who;     ///< that or its last word: "ann"
  std::string action;  ///< that it begins with
  std::string object;  ///< that it contains
  std::optional<Timestamp> from;
  std::optional<Timestamp> until;        ///< not included
  std::optional<int64_t> before_number;  ///< the page before that entry
  size_t limit = 100;
};

/// Keeps what a site decides and what happens at it: the rights, as text of `server/access`, whether only who
/// has keys takes part, and the audit log. One SQLite file beside the maps; one thread at a time.
class SiteFile {
 public:
  /// Opens the file, or makes it. Errors: kDamaged (not to be read, or of another program), kConfiguration
  /// (of a newer version), kIo.
  [[nodiscard]] static Result<SiteFile> open(const std::filesystem::path& path);

  /// The text that was kept last; nothing when none ever was. Error kDamaged: it is not what was written.
  [[nodiscard]] Result<std::optional<std::string>> rights();
  /// Keeps the rights; they are durable with the entry that says who changed them and how, or nothing is.
  [[nodiscard]] Status keep_rights(std::string_view text, const AuditEntry& entry);

  /// Time since when only those with keys take part; nothing: it is an open site. Error kDamaged, as of
  /// rights().
  [[nodiscard]] Result<std::optional<Timestamp>> secured_since();
  /// Makes the site a secured one from `entry.time` on, with these rights: durable with the entry, or not at
  /// all.
  [[nodiscard]] Status keep_secured(std::string_view rights, const AuditEntry& entry);

  /// Fingerprint of the authority whose keys a secured site was last used with; nothing: none yet. Error
  /// kDamaged, as of rights().
  [[nodiscard]] Result<std::optional<std::string>> authority();
  /// Keeps that fingerprint; it is durable with the entry, if there is one, or nothing is.
  [[nodiscard]] Status keep_authority(std::string_view fingerprint, const std::optional<AuditEntry>& entry);

  /// Appends to the audit log; the entries are durable on return.
  [[nodiscard]] Status append(std::span<const AuditEntry> entries);
  /// Entries of the audit log that match a query, the newest first.
  [[nodiscard]] Result<std::vector<AuditEntry>> find(const AuditQuery& query);
  /// Where there are more than `most` entries, removes the oldest of those who have most: who places labels
  /// day and night pushes out nobody else's. Returns how many went.
  [[nodiscard]] Result<int64_t> prune(int64_t most);

 private:
  explicit SiteFile(sqlite::Database database) : database_(std::move(database)) {}
  [[nodiscard]] Result<std::optional<std::string>> text_in(const char* table);
  [[nodiscard]] Status put(const char* table, std::string_view text);
  [[nodiscard]] Status insert(std::span<const AuditEntry> entries);
  /// Who has entries in the audit log, and how many, by rising number.
  [[nodiscard]] Result<std::vector<std::pair<std::string, int64_t>>> entries_of_each();

  sqlite::Database database_;
  /// Entries of the audit log; the most: not counted yet.
  int64_t at_most_ = std::numeric_limits<int64_t>::max();
};

}  // namespace cairn
