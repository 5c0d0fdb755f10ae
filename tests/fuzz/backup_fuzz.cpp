// SPDX-License-Identifier: Apache-2.0
//
// Backups: an operator restores what somebody kept for years. Nothing is written while one is looked at.
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <optional>

#include "server/store/backup.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {

void decode(Bytes bytes) {
  const MemoryFile file(bytes);
  uint64_t told = 0;
  const auto content = read_backup(file.path(), std::nullopt, [&](uint64_t done, uint64_t) { told = done; });
  demand(told <= bytes.size(), "no more is read than there is");
  if (!content) return demand(!content.error().message.empty(), "a refusal has a reason");
  for (const BackupPart& part : content->parts) {
    demand(is_backup_part(part.name), "a part is a file of a store: " + part.name);
    demand(part.bytes <= bytes.size(), "a part is no longer than the backup");
  }
}

std::vector<Input> seeds() {
  const OwnFolder folder;
  std::vector<Input> all;
  const auto add = [&](std::initializer_list<std::pair<const char*, std::string_view>> parts) {
    const auto path = folder.path() / ("backup-" + std::to_string(all.size()));
    auto writer = BackupWriter::create(path);
    demand(writer.has_value(), "a backup can be begun");
    for (const auto& [name, content] : parts) {
      folder.write("part", bytes_of(content));
      demand(writer->add(name, folder.path() / "part").has_value(), "a file can be added");
    }
    demand(writer->finish(Timestamp{1'800'000'000'000'000'000}, "0.1.0").has_value(),
           "a backup can be ended");
    std::ifstream in(path, std::ios::binary);
    all.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    decode(all.back());
  };
  add({{"catalogue.db", ""}, {"site.db", ""}});
  add({{"maps/00112233445566778899aabbccddeeff.cairnmap", "a map"},
       {"catalogue.db", "the server"},
       {"site.db", "the rights"}});
  add({{"deleted/00112233445566778899aabbccddeeff.cairnmap", "one that was deleted"},
       {"catalogue.db", "the server"},
       {"site.db", "the rights"}});
  return all;
}

}  // namespace cairn::fuzz
