// SPDX-License-Identifier: Apache-2.0
//
// Keyframes that were kept aside. They are no part of the map's state: tags and roll-backs leave them alone.
#include <algorithm>
#include <utility>

#include "server/store/bytes.h"
#include "server/store/map_file.h"
#include "server/store/proposal_codec.h"
#include "server/store/row_codec.h"
#include "server/store/rows.h"

namespace cairn {
namespace {

/// Row of table proposals with the highest number that was given. An operator may still mean by a number what
/// has been dropped since.
constexpr int64_t kLastNumberRow = 0;

std::optional<uint64_t> decode_last_number(std::span<const uint8_t> row) {
  ByteReader in(row);
  const auto last = in.get<uint64_t>();
  return in.finished() && last <= kMostProposalNumber ? std::optional(last) : std::nullopt;
}

/// Content of table proposals.
struct ProposalRows {
  std::vector<ProposalSummary> sound;
  std::vector<std::pair<int64_t, std::string>> unfit;  ///< read, and nothing can be made of them: id, and why
  uint64_t last_number = 0;
  Status all;  ///< an error: there may be more, of which nothing is known
};

ProposalRows read_proposals(sqlite::Database* database) {
  ProposalRows rows;
  rows.all = read_table(
      database, "proposals",
      [&rows](int64_t id, std::span<const uint8_t> data) {
        if (id == kLastNumberRow) {
          const auto last = decode_last_number(data);
          rows.last_number = last.value_or(0);
          return last.has_value();
        }
        auto proposal = decode_proposal(id, data);
        if (!proposal) return false;
        rows.sound.push_back(std::move(proposal->summary));
        return true;
      },
      [&rows](int64_t id, std::string what) { rows.unfit.emplace_back(id, std::move(what)); });
  return rows;
}

}  // namespace

Status MapFile::put_proposals(const MapUpdate& update) {
  uint64_t last = update.last_proposal;
  Status done;
  for (const KeptProposal& p : update.proposals) {
    const auto id = static_cast<int64_t>(p.record.summary.number);
    last = std::max(last, p.record.summary.number);
    if (done) done = put("proposals", id, encode_proposal(p.record));
    if (done) done = put("proposal_pictures", id, p.image);
  }
  if (done && last > 0) {
    ByteWriter row;
    row.put(last);
    done = put("proposals", kLastNumberRow, row.take());
  }
  for (const uint64_t number : update.removed_proposals) {
    const auto id = static_cast<int64_t>(number);
    if (done && id != kLastNumberRow) done = remove("proposals", id);
    if (done) done = remove("proposal_pictures", id);
  }
  return done;
}

void MapFile::load_proposals(StoredMap* map) {
  ProposalRows rows = read_proposals(&database_);
  if (!rows.all) map->damage.push_back(rows.all.error().message);
  for (ProposalSummary& sound : rows.sound) map->proposals.push_back(std::move(sound));
  for (auto& [id, what] : rows.unfit) map->lost_proposals.push_back(std::move(what));
  // Of those that could not be read, too.
  const auto highest = database_.number("SELECT coalesce(max(id), 0) FROM proposals");
  const uint64_t last = highest && *highest > 0 ? static_cast<uint64_t>(*highest) : 0;
  map->last_proposal = std::max(map->last_proposal, rows.last_number);
  if (last <= kMostProposalNumber) map->last_proposal = std::max(map->last_proposal, last);
}

Status MapFile::forget_lost_proposals(const StoredMap& read) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  // Each row is judged by itself once more: one that was not read is not unfit for that.
  const ProposalRows rows = read_proposals(&database_);
  Status done = rows.all;
  for (const auto& [id, what] : rows.unfit) {
    if (done) done = remove("proposals", id);
    if (done) done = remove("proposal_pictures", id);
  }
  MapUpdate anew;
  anew.last_proposal = read.last_proposal;
  if (done) done = put_proposals(anew);
  return done ? transaction->commit() : done;
}

std::vector<std::string> MapFile::check_proposals() {
  std::vector<std::string> faults;
  StoredMap map;
  load_proposals(&map);
  for (const ProposalSummary& p : map.proposals) {
    const auto kept = read_proposal(p.number);
    if (!kept || decode_image_row(kept->image) == nullptr)
      faults.push_back("table proposal_pictures, row " + std::to_string(p.number) +
                       ": the image is missing or damaged");
  }
  return faults;
}

Result<KeptProposal> MapFile::read_proposal(uint64_t number) {
  const auto id = static_cast<int64_t>(number);
  auto row = read_row("proposals", id);
  if (!row) return tl::unexpected(row.error());
  auto record = decode_proposal(id, *row);
  if (!record)
    return fail(ErrorCode::kDamaged,
                database_.path() + ": table proposals, row " + std::to_string(number) + " makes no sense");
  auto image = read_row("proposal_pictures", id);
  if (!image) return tl::unexpected(image.error());
  return KeptProposal{std::move(*record), std::move(*image)};
}

Status MapFile::erase_proposals() {
  const auto rows = database_.number("SELECT count(*) FROM proposals WHERE id > 0");
  if (!rows) return tl::unexpected(rows.error());
  if (*rows == 0) return {};
  // Overwritten, too: the file goes to others.
  Status done = database_.execute(
      "PRAGMA secure_delete = ON; DELETE FROM proposals WHERE id <> 0; DELETE FROM proposal_pictures");
  return done ? write_back() : done;
}

}  // namespace cairn
