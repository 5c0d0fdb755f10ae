// SPDX-License-Identifier: Apache-2.0
#include "server/store/rows.h"

#include <zlib.h>

namespace cairn {

int64_t row_checksum(int64_t id, std::span<const uint8_t> data) {
  uLong sum = crc32(0, reinterpret_cast<const Bytef*>(&id), sizeof(id));
  sum = crc32_z(sum, data.data(), data.size());
  return static_cast<int64_t>(sum);
}

std::string put_row_sql(std::string_view table) {
  return "INSERT OR REPLACE INTO " + std::string(table) + "(id, data, checksum) VALUES(?, ?, ?)";
}

void read_rows(sqlite::Database* database, std::string_view table,
               const std::function<bool(int64_t id, std::span<const uint8_t> data)>& use,
               std::vector<std::string>* damage) {
  const std::string name(table);
  auto query = database->prepare("SELECT id, data, checksum FROM " + name + " ORDER BY id");
  if (!query) return damage->push_back("table " + name + ": " + query.error().message);
  while (true) {
    const auto row = query->step();
    if (!row) return damage->push_back("table " + name + ": " + row.error().message);
    if (!*row) return;
    const int64_t id = query->integer(0);
    const auto data = query->blob(1);
    const std::string place = "table " + name + ", row " + std::to_string(id);
    if (query->integer(2) != row_checksum(id, data)) {
      damage->push_back(place + ": the checksum is wrong");
    } else if (!use(id, data)) {
      damage->push_back(place + ": the content is unfit");
    }
  }
}

}  // namespace cairn
