// SPDX-License-Identifier: Apache-2.0
//
// Whole files of the store: archives of maps as an operator imports them, and the site's file as a backup
// brings it. The first byte says which.
#include <fstream>
#include <iterator>

#include "server/store/site_file.h"
#include "server/store/store.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/small_map.h"

namespace cairn::fuzz {
namespace {

const OwnFolder& folder() {
  static const OwnFolder made;
  return made;
}

/// A copy, since both are brought to the present schema when they are opened.
std::filesystem::path copy_of_file(Bytes bytes) {
  const char* const name = "file.db";
  for (const char* log : {"file.db-wal", "file.db-shm", "file.db-journal"}) {
    std::error_code ignored;
    std::filesystem::remove(folder().path() / log, ignored);
  }
  folder().write(name, bytes);
  return folder().path() / name;
}

void read_map(Bytes bytes) {
  const auto path = copy_of_file(bytes);
  if (!check_is_map_file(path)) return;
  const auto map = read_archive(path);
  if (!map) return demand(!map.error().message.empty(), "a refusal has a reason");
  if (map->damage.empty()) static_cast<void>(assemble_map(map->record, RestoredImages::kStay));
}

void read_site(Bytes bytes) {
  auto site = SiteFile::open(copy_of_file(bytes));
  if (!site) return demand(!site.error().message.empty(), "a refusal has a reason");
  static_cast<void>(site->rights());
  static_cast<void>(site->find({}));
  static_cast<void>(site->append({}));
}

Input whole_file(size_t kind, const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const Input bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return input_of(kind, Bytes(bytes));
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  bytes[0] % 2 == 0 ? read_map(bytes.subspan(1)) : read_site(bytes.subspan(1));
}

std::vector<Input> seeds() {
  const auto map_path = folder().path() / "map.db";
  const auto site_path = folder().path() / "site.db";
  for (const auto& path : {map_path, site_path}) std::filesystem::remove(path);
  {
    auto map =
        MapFile::create(map_path, small_header(), {small_record(), {small_decision()}, {small_label()}, {}});
    demand(map.has_value() && map->write_back().has_value(), "a map can be written");
    auto site = SiteFile::open(site_path);
    const AuditEntry entry{0, Timestamp{1}, "operator ann", "rights grant", "client phone-1", "done"};
    demand(site.has_value() && site->keep_rights("{}", entry).has_value(), "a site can be written");
  }
  return {whole_file(0, map_path), whole_file(1, site_path)};
}

}  // namespace cairn::fuzz
