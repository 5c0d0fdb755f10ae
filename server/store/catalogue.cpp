// SPDX-License-Identifier: Apache-2.0
//
// The catalogue of a store: which server this is, the last epoch that it has given, and which maps overlap.
#include <algorithm>
#include <chrono>
#include <random>

#include "server/store/bytes.h"
#include "server/store/entry_codec.h"
#include "server/store/row_codec.h"
#include "server/store/rows.h"
#include "server/store/schema.h"
#include "server/store/store.h"

namespace cairn {
namespace {

constexpr int64_t kServerRow = 1;

uint64_t wall_clock_ms() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::milliseconds>(since_epoch).count());
}

}  // namespace

std::filesystem::path Store::catalogue_path() const {
  return folder_ / "catalogue.db";
}

Status Store::read_catalogue() {
  const std::filesystem::path path = catalogue_path();
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kCreate);
  if (!database) return tl::unexpected(database.error());
  const auto version = schema_version(&*database, catalogue_schema());
  if (!version) return tl::unexpected(version.error());
  auto transaction = sqlite::Transaction::begin(&*database);
  if (!transaction) return tl::unexpected(transaction.error());
  const auto newest = static_cast<int>(catalogue_schema().steps.size());
  Status done = migrate(&*database, catalogue_schema(), *version, newest);
  if (!done) return done;

  std::vector<std::string> damage;
  uint64_t last_epoch = 0;
  read_rows(
      &*database, "server",
      [&](int64_t, std::span<const uint8_t> data) {
        ByteReader in(data);
        in.get(std::span(server_.bytes));
        last_epoch = in.get<uint64_t>();
        return in.finished();
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, path.string() + ": " + damage.front());
  read_overlaps(&*database);
  if (!server_) {
    std::random_device device;
    for (uint8_t& byte : server_.bytes) byte = static_cast<uint8_t>(device());
  }
  start_count_ = std::max(last_epoch + 1, wall_clock_ms());
  last_epoch_ = start_count_;
  done = put_server(&*database, start_count_);
  return done ? transaction->commit() : done;
}

Status Store::put_server(sqlite::Database* catalogue, uint64_t last_epoch) const {
  ByteWriter row;
  row.put(std::span<const uint8_t>(server_.bytes));
  row.put(last_epoch);
  const Blob data = row.take();
  auto insert = catalogue->prepare(put_row_sql("server"));
  if (!insert) return tl::unexpected(insert.error());
  return insert->bind(0, kServerRow).bind(1, std::span(data)).bind(2, row_checksum(kServerRow, data)).run();
}

Status Store::keep_last_epoch(uint64_t epoch) const {
  auto database = sqlite::Database::open(catalogue_path(), sqlite::OpenMode::kReadWrite);
  return database ? put_server(&*database, epoch) : tl::unexpected(database.error());
}

/// One mark for all ids: of those that were purged nothing need be kept, and a start is later than all.
Result<Epoch> Store::next_epoch(MapId map, Epoch last_of_file) {
  const std::scoped_lock lock(epochs_mutex_);
  const bool unserved_since_start = not_loaded_.erase(map) > 0;
  const uint64_t later_than_served = unserved_since_start ? start_count_ : last_epoch_ + 1;
  const Epoch epoch{std::max(later_than_served, last_of_file.value + 1)};
  if (epoch.value <= last_epoch_) return epoch;
  // Before anybody is served in it: no later start may give it again.
  if (Status kept = keep_last_epoch(epoch.value); !kept) return tl::unexpected(kept.error());
  last_epoch_ = epoch.value;
  return epoch;
}

void Store::read_overlaps(sqlite::Database* catalogue) {
  overlaps_.clear();
  std::vector<std::string> damage;
  read_rows(
      catalogue, "overlaps",
      [this](int64_t, std::span<const uint8_t> data) {
        const auto overlap = decode_overlap(data);
        if (overlap) overlaps_.push_back(*overlap);
        return overlap.has_value();
      },
      &damage);
  for (const std::string& row : damage) log_->warn("{}: {}; left out", catalogue->path(), row);
}

Status Store::keep_overlaps(std::span<const OverlapRecord> overlaps) const {
  auto database = sqlite::Database::open(catalogue_path(), sqlite::OpenMode::kReadWrite);
  if (!database) return tl::unexpected(database.error());
  auto transaction = sqlite::Transaction::begin(&*database);
  if (!transaction) return tl::unexpected(transaction.error());
  Status done = database->execute("DELETE FROM overlaps");
  auto insert = database->prepare(put_row_sql("overlaps"));
  if (!insert) return tl::unexpected(insert.error());
  for (size_t i = 0; i < overlaps.size() && done; ++i) {
    const auto row = static_cast<int64_t>(i + 1);
    const Blob data = encode_overlap(overlaps[i]);
    done = insert->bind(0, row).bind(1, std::span(data)).bind(2, row_checksum(row, data)).run();
  }
  return done ? transaction->commit() : done;
}

}  // namespace cairn
