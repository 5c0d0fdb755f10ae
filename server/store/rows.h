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

/// Whether it can make anything of a row.
using UseRow = std::function<bool(int64_t id, std::span<const uint8_t> data)>;

/// All rows of a table.
inline constexpr std::string_view kAllRows = "true";

/// Shows each sound row of those where the condition `which` holds to `use`, by ascending key. Rows that are
/// damaged or useless are named to `unfit`. An error: the table cannot be read to its end (a failing disk, no
/// memory, a broken page), and what follows is unknown.
[[nodiscard]] Status read_table(sqlite::Database* database, std::string_view table, const UseRow& use,
                                const std::function<void(int64_t id, std::string what)>& unfit,
                                std::string_view which = kAllRows);

/// read_table() where a table that cannot be read to its end is damage like that of a row.
void read_rows(sqlite::Database* database, std::string_view table, const UseRow& use,
               std::vector<std::string>* damage, std::string_view which = kAllRows);

}  // namespace cairn
