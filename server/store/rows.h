// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/sqlite.h"

/// Tables whose rows are a key, a blob and a checksum of both.
namespace cairn {

/// CRC-32 of key and blob: tells a row that is damaged, or that stands under another key.
[[nodiscard]] int64_t row_checksum(int64_t id, std::span<const uint8_t> data);

/// "INSERT OR REPLACE" of a row of `table`: parameters id, data, checksum.
[[nodiscard]] std::string put_row_sql(std::string_view table);

/// Shows each sound row to `use`, which returns whether it can make anything of it. Rows that are damaged or
/// useless, and a table that cannot be read to its end, are named in `damage`.
void read_rows(sqlite::Database* database, std::string_view table,
               const std::function<bool(int64_t id, std::span<const uint8_t> data)>& use,
               std::vector<std::string>* damage);

}  // namespace cairn
