// SPDX-License-Identifier: Apache-2.0
//
// Tags of a map: states that can be had back. Of each row that changes after a tag was made, the table `kept`
// holds what it was then; the state of a tag is, row by row, what was kept for it or for the first later tag
// that kept something, else what there is now.
#include <algorithm>
#include <array>
#include <map>
#include <tuple>
#include <utility>

#include "server/store/bytes.h"
#include "server/store/entry_codec.h"
#include "server/store/map_file.h"
#include "server/store/rows.h"

namespace cairn {
namespace {

constexpr size_t kMostTags = 1000;  ///< of a map
constexpr int64_t kHeaderRow = 1;   ///< of table map: who the map is stays as it is

/// The tables that are the state of a map; their places here are in files.
constexpr std::array<std::string_view, 10> kParts{"map",    "cameras",      "found_cameras", "keyframes",
                                                  "images", "measurements", "sources",       "positions",
                                                  "labels", "contributors"};

enum class KeptRow : uint8_t { kAbsent = 0, kPresent = 1, kDamaged = 2 };

// The id of a kept row: tag, part and id of the row, from the highest bit on.
constexpr int kIdBits = 40;
constexpr int kPartBits = 4;
constexpr int64_t kIdOffset = int64_t{1} << (kIdBits - 1);  ///< some ids are below 0
constexpr int64_t kIdMask = (int64_t{1} << kIdBits) - 1;

int64_t first_kept_of(uint64_t tag) {
  return static_cast<int64_t>(tag << (kIdBits + kPartBits));
}

int64_t kept_id(uint64_t tag, size_t part, int64_t id) {
  return first_kept_of(tag) | static_cast<int64_t>(part) << kIdBits | ((id + kIdOffset) & kIdMask);
}

struct Place {
  size_t part = 0;
  int64_t id = 0;
  auto operator<=>(const Place&) const = default;
};

Place place_of(int64_t kept) {
  return {static_cast<size_t>(kept >> kIdBits) % (size_t{1} << kPartBits), (kept & kIdMask) - kIdOffset};
}

}  // namespace

Status MapFile::learn_newest_tag() {
  const auto newest = database_.number("SELECT coalesce(max(id), 0) FROM tags");
  if (!newest) return tl::unexpected(newest.error());
  newest_tag_ = static_cast<uint64_t>(*newest);
  return {};
}

Status MapFile::keep_as_tagged(std::string_view table, int64_t id) {
  if (newest_tag_ == 0) return {};
  const auto found = std::find(kParts.begin(), kParts.end(), table);
  if (found == kParts.end() || (table == kParts[0] && id == kHeaderRow)) return {};
  const int64_t key = kept_id(newest_tag_, static_cast<size_t>(found - kParts.begin()), id);
  const auto known = statement("SELECT 1 FROM kept WHERE id = ?");
  if (!known) return tl::unexpected(known.error());
  const auto is_kept = (*known)->bind(0, key).step();
  (*known)->reset();
  if (!is_kept) return tl::unexpected(is_kept.error());
  if (*is_kept) return {};

  const auto select = statement("SELECT data, checksum FROM " + std::string(table) + " WHERE id = ?");
  if (!select) return tl::unexpected(select.error());
  const auto is_there = (*select)->bind(0, id).step();
  if (!is_there) return tl::unexpected(is_there.error());
  ByteWriter row;
  if (*is_there) {
    const auto data = (*select)->blob(0);
    const bool is_sound = (*select)->integer(1) == row_checksum(id, data);
    row.put(static_cast<uint8_t>(is_sound ? KeptRow::kPresent : KeptRow::kDamaged));
    row.put(data);
  } else {
    row.put(static_cast<uint8_t>(KeptRow::kAbsent));
  }
  (*select)->reset();
  return put("kept", key, row.take());
}

Result<std::vector<MapTag>> MapFile::tags() {
  std::vector<MapTag> tags;
  std::vector<std::string> damage;
  read_rows(
      &database_, "tags",
      [&tags](int64_t id, std::span<const uint8_t> data) {
        auto tag = decode_tag(id, data);
        if (tag) tags.push_back(std::move(*tag));
        return tag.has_value();
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + damage.front());
  return tags;
}

Result<MapTag> MapFile::find_tag(const std::string& name) {
  auto all = tags();
  if (!all) return tl::unexpected(all.error());
  const auto found = std::find_if(all->begin(), all->end(), [&](const MapTag& t) { return t.name == name; });
  if (found == all->end()) {
    return fail(ErrorCode::kNotFound, "map " + header_.name + " has no tag '" + name + "'; `cairnctl map " +
                                          header_.name + " tags` lists them");
  }
  return std::move(*found);
}

Status MapFile::tag(MapTag tag) {
  const auto all = tags();
  if (!all) return tl::unexpected(all.error());
  for (const MapTag& other : *all) {
    if (other.name == tag.name) {
      return fail(ErrorCode::kRefused,
                  "map " + header_.name + " has a tag '" + tag.name + "' already; choose another name");
    }
  }
  if (all->size() >= kMostTags) {
    return fail(ErrorCode::kRefused, "map " + header_.name + " has " + std::to_string(kMostTags) +
                                         " tags, and no more are kept; remove one (`untag`)");
  }
  tag.number = newest_tag_ + 1;
  tag.keyframe_count = keyframe_count_;
  tag.point_count = point_count_;
  tag.epoch = header_.epoch;
  Status done = put("tags", static_cast<int64_t>(tag.number), encode_tag(tag));
  if (done) newest_tag_ = tag.number;
  return done;
}

Status MapFile::untag(const std::string& name) {
  const auto tag = find_tag(name);
  if (!tag) return tl::unexpected(tag.error());
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  const auto before =
      database_.number("SELECT coalesce(max(id), 0) FROM tags WHERE id < " + std::to_string(tag->number));
  if (!before) return tl::unexpected(before.error());
  // What it kept is what the tag before it needs where that has kept nothing of its own.
  std::vector<int64_t> keys;
  auto select = database_.prepare("SELECT id FROM kept WHERE id >= ? AND id < ?");
  if (!select) return tl::unexpected(select.error());
  select->bind(0, first_kept_of(tag->number)).bind(1, first_kept_of(tag->number + 1));
  while (true) {
    const auto row = select->step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    keys.push_back(select->integer(0));
  }
  const auto exists = statement("SELECT 1 FROM kept WHERE id = ?");
  if (!exists) return tl::unexpected(exists.error());
  Status done;
  for (const int64_t key : keys) {
    if (!done) break;
    const Place place = place_of(key);
    const int64_t inherited = kept_id(static_cast<uint64_t>(*before), place.part, place.id);
    bool is_wanted = false;
    if (*before > 0) {
      const auto has_own = (*exists)->bind(0, inherited).step();
      (*exists)->reset();
      if (!has_own) return tl::unexpected(has_own.error());
      is_wanted = !*has_own;
    }
    if (is_wanted) {
      const auto row = read_row("kept", key);
      if (!row) return tl::unexpected(row.error());
      done = put("kept", inherited, *row);
    }
    if (done) done = remove("kept", key);
  }
  if (done) done = remove("tags", static_cast<int64_t>(tag->number));
  if (done) done = transaction->commit();
  return done ? learn_newest_tag() : done;
}

std::vector<std::string> MapFile::check_tags() {
  std::vector<std::string> damage;
  read_rows(
      &database_, "tags",
      [](int64_t id, std::span<const uint8_t> row) { return decode_tag(id, row).has_value(); }, &damage);
  read_rows(
      &database_, "kept",
      [](int64_t, std::span<const uint8_t> row) {
        return !row.empty() && row.front() < static_cast<uint8_t>(KeptRow::kDamaged);
      },
      &damage);
  return damage;
}

Status MapFile::roll_back(const std::string& name, MapTag before, Epoch epoch, const AcceptState& accept) {
  const auto tag = find_tag(name);
  if (!tag) return tl::unexpected(tag.error());
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  const auto state = std::tuple(header_, keyframe_count_, point_count_, newest_tag_);
  Status done = replace_by(*tag, std::move(before), epoch, accept);
  if (done) done = transaction->commit();
  if (!done) std::tie(header_, keyframe_count_, point_count_, newest_tag_) = state;
  cameras_.clear();  // they are read again
  return done;
}

Status MapFile::replace_by(const MapTag& tag, MapTag before, Epoch epoch, const AcceptState& accept) {
  if (Status tagged = this->tag(std::move(before)); !tagged) return tagged;
  if (Status back = put_back(tag.number); !back) return back;
  const auto begun = epoch_after(tag, epoch);
  if (!begun) return tl::unexpected(begun.error());
  keyframe_count_ = tag.keyframe_count;
  point_count_ = tag.point_count;
  Status done = put_epoch(*begun);
  if (done) done = forget_keyframes_beyond(begun->keyframes);
  if (done && accept) done = accept(load());
  return done;
}

/// Ids in common with the tag end at the fewest items of any epoch begun since: what was given a higher id
/// since is not what the tag has under that id.
Result<EpochRecord> MapFile::epoch_after(const MapTag& tag, Epoch epoch) {
  std::vector<EpochRecord> all;
  std::vector<std::string> damage;
  read_rows(
      &database_, "epochs",
      [&all](int64_t id, std::span<const uint8_t> data) {
        const auto record = decode_epoch(id, data);
        if (record) all.push_back(*record);
        return record.has_value();
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + damage.front());
  EpochRecord begun{epoch, tag.keyframe_count, tag.point_count};
  for (size_t i = 1; i < all.size(); ++i) {  // the first came before all tags
    if (all[i].epoch <= tag.epoch) continue;
    begun.keyframes = std::min(begun.keyframes, all[i].keyframes);
    begun.points = std::min(begun.points, all[i].points);
  }
  return begun;
}

Status MapFile::put_back(uint64_t tag) {
  std::map<Place, int64_t> kept;
  auto select = database_.prepare("SELECT id FROM kept WHERE id >= ? ORDER BY id");
  if (!select) return tl::unexpected(select.error());
  select->bind(0, first_kept_of(tag));
  while (true) {
    const auto row = select->step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    kept.emplace(place_of(select->integer(0)), select->integer(0));  // the first tag's counts
  }
  for (const auto& [place, key] : kept) {
    const auto row = read_row("kept", key);
    if (!row) return tl::unexpected(row.error());
    const bool is_sound =
        place.part < kParts.size() && !row->empty() && row->front() < static_cast<uint8_t>(KeptRow::kDamaged);
    if (!is_sound) {
      return fail(ErrorCode::kDamaged, database_.path() + ": table kept, row " + std::to_string(key) +
                                           ": what was tagged is damaged");
    }
    const bool was_there = row->front() == static_cast<uint8_t>(KeptRow::kPresent);
    const std::string_view table = kParts[place.part];
    const Status done =
        was_there ? put(table, place.id, std::span(*row).subspan(1)) : remove(table, place.id);
    if (!done) return done;
  }
  return {};
}

Status MapFile::forget_keyframes_beyond(size_t count) {
  std::map<int64_t, DecisionRecord> changed;
  std::vector<std::string> damage;  // is told by who loads the map
  read_rows(
      &database_, "decisions",
      [&](int64_t id, std::span<const uint8_t> data) {
        auto decision = decode_decision(data);
        if (!decision) return false;
        if (decision->keyframe.value <= count) return true;
        decision->keyframe = {};
        changed.emplace(id, std::move(*decision));
        return true;
      },
      &damage);
  for (const auto& [id, decision] : changed) {
    if (Status done = put("decisions", id, encode_decision(decision)); !done) return done;
  }
  return {};
}

}  // namespace cairn
