// SPDX-License-Identifier: Apache-2.0
#include "server/store/rows.h"

#include <zlib.h>

#include <utility>

namespace cairn {

int64_t row_checksum(int64_t id, std::span<const uint8_t> data) {
  uLong sum = crc32(0, reinterpret_cast<const Bytef*>(&id), sizeof(id));
  sum = crc32_z(sum, data.data(), data.size());
  return static_cast<int64_t>(sum);
}

std::string put_row_sql(std::string_view table) {
  return "INSERT OR REPLACE INTO " + std::string(table) + "(id, data, checksum) VALUES(?, ?, ?)";
}

Status read_table(sqlite::Database* database, std::string_view table, const UseRow& use,
                  const std::function<void(int64_t id, std::string what)>& unfit, std::string_view which) {
  const std::string name(table);
  const auto of_table = [&name](const Error& error) {
    return fail(error.code, "table " + name + ": " + error.message);
  };
  auto query = database->prepare("SELECT id, data, checksum FROM " + name + " WHERE " + std::string(which) +
                                 " ORDER BY id");
  if (!query) return of_table(query.error());
  while (true) {
    const auto row = query->step();
    if (!row) return of_table(row.error());
    if (!*row) return {};
    const int64_t id = query->integer(0);
    const auto data = query->blob(1);
    const std::string place = "table " + name + ", row " + std::to_string(id);
    if (query->integer(2) != row_checksum(id, data)) {
      unfit(id, place + ": the checksum is wrong");
    } else if (!use(id, data)) {
      unfit(id, place + ": the content is unfit");
    }
  }
}

void read_rows(sqlite::Database* database, std::string_view table, const UseRow& use,
               std::vector<std::string>* damage, std::string_view which) {
  const auto unfit = [damage](int64_t, std::string what) { damage->push_back(std::move(what)); };
  const Status read = read_table(database, table, use, unfit, which);
  if (!read) damage->push_back(read.error().message);
}

}  // namespace cairn
