// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "server/store/sqlite.h"

/// Schemas as the list of steps that lead to them: a new file takes all of them, an old one those that it
/// lacks.
namespace cairn {

struct Schema {
  int32_t application_id;              ///< tells the kinds of file apart
  std::span<const char* const> steps;  ///< SQL; step i leads from version i to i + 1
};

/// One map (map_file.h).
[[nodiscard]] const Schema& map_schema();
/// Schema of the catalogue: what belongs to the server as a whole (store.h).
[[nodiscard]] const Schema& catalogue_schema();
/// Schema of the site's file: what a site decides, and what happens at it (site_file.h).
[[nodiscard]] const Schema& site_schema();

/// Version of an open file; 0: nothing has been written to it. Error kDamaged: a database of another program.
[[nodiscard]] Result<int> schema_version(sqlite::Database* database, const Schema& schema);
/// Whether an open file is sound and has the tables of its version and nothing else: a view or trigger of
/// somebody's making would run in our queries. For files from elsewhere. Takes as long as reading the file.
/// Error kDamaged.
[[nodiscard]] Status check_schema(sqlite::Database* database, const Schema& schema, int version);
/// Brings an open file, within a transaction of the caller's, from `version` to `target`.
[[nodiscard]] Status migrate(sqlite::Database* database, const Schema& schema, int version, int target);

}  // namespace cairn
