// SPDX-License-Identifier: Apache-2.0
#include "server/store/store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "server/store/damaged_folder.h"
#include "server/store/database_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFreshSuffix = ".new";    ///< being made: nobody has been told of it
constexpr const char* kSavedSuffix = ".saved";  ///< whole, in place of one that is being set aside
constexpr size_t kMaxOpenFiles = 64;            ///< three descriptors each
constexpr size_t kProbeBytes = 1 << 20;         ///< two keyframes (README.md)

constexpr const char* kLoneLogEnd = "-log";  ///< of a name in `damaged` that no file gets

/// Reasons, for operators, of set-aside files that have no others.
constexpr const char* kLoneLog = "a log without its file: the map's last changes may be in it";
constexpr const char* kAsideAtEnd =
    "the server ended while it set this aside; the reasons are in what it logged then";

std::optional<MapId> map_of(const fs::path& path) {
  if (path.extension() != kMapSuffix) return std::nullopt;
  const auto bytes = from_hex(path.stem().string());
  return bytes ? std::optional(MapId{*bytes}) : std::nullopt;
}

std::vector<MapId> maps_in(const fs::path& folder) {
  std::vector<MapId> maps;
  std::error_code problem;
  for (const auto& entry : fs::directory_iterator(folder, problem)) {
    if (const auto map = map_of(entry.path())) maps.push_back(*map);
  }
  std::sort(maps.begin(), maps.end());
  return maps;
}

bool is_half_made(const fs::path& path) {
  const std::string extension = path.extension();
  return extension == kFreshSuffix ||
         std::any_of(std::begin(kCompanions), std::end(kCompanions), [&](const char* companion) {
           return extension == std::string(kFreshSuffix) + companion;
         });
}

/// A map's file, durable and whole in one file, or nothing.
Status make_file(const fs::path& path, const MapHeader& header, const MapUpdate& content,
                 MapFile* images = nullptr, const KeyframeIds& now = {}) {
  const auto make = [&]() -> Status {
    if (Status removed = remove_database(path); !removed) return removed;
    auto file = MapFile::create(path, header, content);
    if (!file) return tl::unexpected(file.error());
    const Status taken = images != nullptr ? file->take_images(images, now) : Status();
    return taken ? file->write_back() : taken;
  };
  Status made = make();
  if (!made) discard_database(path);
  return made;
}

/// Error kDamaged: it is the file of another map.
Status check_is_of(MapId map, const MapHeader& header, const fs::path& path) {
  if (header.id == map) return {};
  return fail(ErrorCode::kDamaged, path.string() + ": holds another map, " + to_hex(header.id.bytes));
}

/// Name of the tag that is made before a roll-back, by which it can be taken back.
std::string free_name(const std::vector<MapTag>& tags) {
  for (uint64_t number = 1;; ++number) {
    std::string name = "before-rollback-" + std::to_string(number);
    if (std::ranges::none_of(tags, [&](const MapTag& tag) { return tag.name == name; })) return name;
  }
}

}  // namespace

/// Holds the folder against other servers, also after a crash: the kernel lets go of it.
struct Store::Lock {
  explicit Lock(int d) : descriptor(d) {}
  ~Lock() { ::close(descriptor); }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;
  int descriptor;
};

Store::Store(fs::path folder, std::unique_ptr<Lock> lock, Logger log)
    : folder_(std::move(folder)), lock_(std::move(lock)), log_(std::move(log)) {}
Store::~Store() = default;

Result<std::unique_ptr<Store>> Store::open(const fs::path& folder, Logger log) {
  std::error_code problem;
  for (const char* part : {"maps", "deleted", "damaged", "transfer"}) {
    fs::create_directories(folder / part, problem);
    if (problem) return io_failure(folder / part, "cannot be made: " + problem.message());
  }
  const fs::path lock_path = folder / "lock";
  const int descriptor = ::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (descriptor < 0) return io_failure(lock_path, std::strerror(errno));
  auto lock = std::make_unique<Lock>(descriptor);
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK)
      return io_failure(lock_path, std::string("cannot be locked: ") + std::strerror(errno) +
                                       "; --store needs a file system with locks");
    return fail(ErrorCode::kRefused,
                folder.string() + ": in use by another server; give each its own --store");
  }
  std::unique_ptr<Store> store(new Store(folder, std::move(lock), std::move(log)));
  for (const char* part : {"maps", "deleted"}) {
    if (Status parted = store->part_with_lone_logs(part); !parted) return tl::unexpected(parted.error());
  }
  if (Status finished = store->finish_replacements(); !finished) return tl::unexpected(finished.error());
  const auto left_over = entries_of(folder / "transfer");
  if (!left_over) return tl::unexpected(left_over.error());
  for (const fs::path& path : *left_over) fs::remove_all(path, problem);
  if (Status opened = store->open_catalogue(); !opened) return tl::unexpected(opened.error());
  const std::vector<MapId> there = store->maps();
  store->not_loaded_ = {there.begin(), there.end()};
  return store;
}

/// Parts with logs that a server left that ended while it moved a file.
Status Store::part_with_lone_logs(const char* part) const {
  const auto entries = entries_of(folder_ / part);
  if (!entries) return tl::unexpected(entries.error());
  for (const fs::path& path : *entries) {
    if (path.extension() != kMapLogSuffix || is_there(fs::path(path).replace_extension(kMapSuffix))) continue;
    if (Status parted = part_with_lone_log(path); !parted) return parted;
  }
  return {};
}

/// A log that stays would be taken by SQLite for that of the next file there.
Status Store::part_with_lone_log(const fs::path& log) const {
  std::error_code ignored;
  if (fs::file_size(log, ignored) == 0) {
    fs::remove(log, ignored);
    return {};
  }
  if (const auto file = moved_file_of(log)) {
    const fs::path beside = file->string() + kLogEnd;
    fs::remove(beside, ignored);  // an empty one
    if (Status moved = move_database(log, beside); !moved) return moved;
    if (file->parent_path() == folder_ / "damaged") write_reasons(*file, "", {kAsideAtEnd});
    log_->info("{}: a log that has followed its file, as {}", log.string(), beside.string());
    return {};
  }
  const fs::path aside =
      free_path(folder_ / "damaged", log.stem().string() + "-" + utc_stamp() + kLoneLogEnd, kMapLogSuffix);
  if (Status moved = move_database(log, aside); !moved) return moved;
  write_reasons(aside, "", {kLoneLog});
  log_->error("{}: a log without its file; kept as {}", log.string(), aside.string());
  return {};
}

std::optional<fs::path> Store::moved_file_of(const fs::path& log) const {
  const std::string map = log.stem().string();
  for (const char* part : {"maps", "deleted"}) {
    fs::path file = folder_ / part / (map + kMapSuffix);
    if (is_there(file) && !has_log(file)) return file;
  }
  std::optional<fs::path> found;
  for (const fs::path& file : entries_of(folder_ / "damaged").value_or(std::vector<fs::path>())) {
    // The reasons are written when all has been moved.
    const bool was_under_way = file.extension() == kMapSuffix && file.filename().string().starts_with(map) &&
                               !has_log(file) && !is_there(reasons_path_of(file));
    if (!was_under_way) continue;
    if (found) return std::nullopt;  // nobody knows whose it is
    found = file;
  }
  return found;
}

Status Store::put_in_place(const fs::path& from, const fs::path& to) const {
  const fs::path log = to.string() + kLogEnd;
  if (is_there(log) && !is_there(to)) {
    if (Status parted = part_with_lone_log(log); !parted) return parted;
  }
  return move_database(from, to);
}

Status Store::finish_replacements() {
  const auto entries = entries_of(folder_ / "maps");
  if (!entries) return tl::unexpected(entries.error());
  std::error_code ignored;
  for (const fs::path& path : *entries) {
    if (is_half_made(path)) fs::remove(path, ignored);
    const fs::path place = fs::path(path).replace_extension(kMapSuffix);
    const auto map = map_of(place);
    if (path.extension() != kSavedSuffix || !map) continue;
    if (is_there(place)) {
      fs::remove(path, ignored);  // the damaged one has not been set aside yet: it will be found again
    } else if (const Status moved = put_in_place(path, place); !moved) {
      log_->error("map {} is not in its place: {}", to_hex(map->bytes), moved.error().message);
      unplaced_.push_back({*map, "", path, moved.error().message});
    }
  }
  return {};
}

Status Store::open_catalogue() {
  const fs::path path = catalogue_path();
  std::error_code problem;
  const bool is_empty = fs::file_size(path, problem) == 0;
  const bool is_missing = problem == std::errc::no_such_file_or_directory;
  if (!maps().empty() && (is_empty || is_missing))
    log_->error("{}: {}, though there are maps; begun anew: clients take this for another server",
                path.string(), is_missing ? "not there" : "empty");
  Status read = read_catalogue();
  if (!read && read.error().code == ErrorCode::kDamaged) {
    const fs::path aside = free_path(folder_ / "damaged", "catalogue-" + utc_stamp(), kCatalogueSuffix);
    log_->error("{}; kept as {}, begun anew: clients take this for another server", read.error().message,
                aside.string());
    if (Status moved = move_database(path, aside); !moved) return moved;
    write_reasons(aside, "", {read.error().message});
    read = read_catalogue();
  }
  return read;
}

// ---- which maps there are

fs::path Store::path_of(MapId map) const {
  return folder_ / "maps" / (to_hex(map.bytes) + kMapSuffix);
}

fs::path Store::fresh_path_of(MapId map) const {
  return folder_ / "maps" / (to_hex(map.bytes) + kFreshSuffix);
}

fs::path Store::saved_path_of(MapId map) const {
  return folder_ / "maps" / (to_hex(map.bytes) + kSavedSuffix);
}

fs::path Store::deleted_path_of(MapId map) const {
  return folder_ / "deleted" / (to_hex(map.bytes) + kMapSuffix);
}

std::vector<MapId> Store::maps() const {
  return maps_in(folder_ / "maps");
}

std::vector<MapId> Store::deleted_ids() const {
  return maps_in(folder_ / "deleted");
}

std::vector<DeletedMap> Store::deleted_maps() const {
  std::vector<DeletedMap> maps;
  for (const MapId map : deleted_ids()) {
    const fs::path path = deleted_path_of(map);
    struct stat file {};
    if (::stat(path.c_str(), &file) != 0) continue;
    DeletedMap& deleted = maps.emplace_back();
    deleted.deleted = changed_at(file);
    deleted.bytes = static_cast<uint64_t>(file.st_size);
    deleted.header.id = map;
    const auto header = MapFile::read_header(path);
    const Status usable = header ? check_is_of(map, *header, path) : tl::unexpected(header.error());
    if (usable) deleted.header = *header;
    if (!usable) deleted.problem = usable.error();
  }
  std::stable_sort(maps.begin(), maps.end(),
                   [](const DeletedMap& a, const DeletedMap& b) { return a.deleted > b.deleted; });
  return maps;
}

std::vector<DeletedDecisions> Store::decisions_on_deleted(size_t maps, int64_t newest) const {
  std::vector<std::pair<int64_t, fs::path>> files;
  for (const MapId map : deleted_ids()) {
    fs::path path = deleted_path_of(map);
    struct stat file {};
    if (::stat(path.c_str(), &file) == 0) files.emplace_back(-changed_at(file).nanoseconds, std::move(path));
  }
  std::ranges::sort(files);
  files.resize(std::min(files.size(), maps));
  std::vector<DeletedDecisions> all;
  for (const auto& [age, path] : files) {
    auto header = MapFile::read_header(path);
    auto decisions = MapFile::read_decisions(path, newest);
    if (header && decisions) all.push_back({std::move(*header), std::move(*decisions)});
  }
  return all;
}

std::vector<DamagedFile> Store::damaged_files() const {
  return damaged_files_in(folder_ / "damaged");
}

Result<MapFile> Store::open_own(MapId map) const {
  auto file = MapFile::open(path_of(map));
  if (!file) return file;
  if (Status its_own = check_is_of(map, file->header(), path_of(map)); !its_own)
    return tl::unexpected(its_own.error());
  return file;
}

Result<StoredMap> Store::load(MapId map) {
  auto file = open_own(map);
  if (!file) return tl::unexpected(file.error());
  const auto epoch = next_epoch(map, file->header().epoch);
  if (!epoch) return tl::unexpected(epoch.error());
  if (Status begun = file->begin_epoch(*epoch); !begun) return tl::unexpected(begun.error());
  StoredMap read = file->load();
  // A damaged file is kept as it was found.
  if (!read.damage.empty() || read.lost_proposals.empty()) return read;
  note_lost_proposals(map, read);
  const Status gone = file->forget_lost_proposals(read);
  if (!gone) log_->error("map {}: {}", to_hex(map.bytes), gone.error().message);  // with the next start
  return read;
}

void Store::note_lost_proposals(MapId map, const StoredMap& read) const {
  for (const std::string& row : read.lost_proposals)
    log_->error("map {}: {}; the proposal is lost, the map is whole", to_hex(map.bytes), row);
}

// ---- changes

Result<MapFile*> Store::file_of(MapId map) {
  const auto it = std::find_if(open_files_.begin(), open_files_.end(),
                               [map](const OpenFile& open) { return open.map == map; });
  if (it != open_files_.end()) {
    open_files_.splice(open_files_.begin(), open_files_, it);
    return &open_files_.front().file;
  }
  auto file = MapFile::open(path_of(map));
  if (!file) return tl::unexpected(file.error());
  keep_open(map, std::move(*file));
  return &open_files_.front().file;
}

void Store::keep_open(MapId map, MapFile file) {
  if (open_files_.size() >= kMaxOpenFiles) open_files_.pop_back();
  open_files_.push_front({map, std::move(file)});
}

void Store::close(MapId map) {
  open_files_.remove_if([map](const OpenFile& open) { return open.map == map; });
}

Status Store::check_is_free(const MapHeader& header) const {
  const std::string id = to_hex(header.id.bytes);
  const std::string map = "map " + id + " (" + header.name + ")";
  for (const fs::path& path : {path_of(header.id), saved_path_of(header.id)}) {
    if (is_there(path))
      return fail(ErrorCode::kRefused,
                  map + " is in the store already, as " + path.string() + " (`cairnctl maps`)");
  }
  if (is_there(deleted_path_of(header.id)))
    return fail(ErrorCode::kRefused, map + " is among the deleted ones, as " +
                                         deleted_path_of(header.id).string() + "; `cairnctl map " + id +
                                         " undelete` puts it back, `cairnctl maps purge " + id +
                                         "` removes it for good");
  return {};
}

Status Store::create(const MapHeader& header, const MapUpdate& whole) {
  Status made = check_is_free(header);
  if (made) made = make(header, whole);
  return made;
}

/// The file is whole before it is moved to its place, so that one there which is not is known to be damaged.
Status Store::make(const MapHeader& header, const MapUpdate& whole, MapFile* images) const {
  const fs::path fresh = fresh_path_of(header.id);
  if (Status made = make_file(fresh, header, whole, images); !made) return made;
  Status moved = put_in_place(fresh, path_of(header.id));
  if (!moved) discard_database(fresh);
  return moved;
}

Status Store::write(MapId map, std::span<const MapUpdate> updates) {
  const auto file = file_of(map);
  return file ? (*file)->write(updates) : tl::unexpected(file.error());
}

Status Store::rename(MapId map, const std::string& name) {
  const auto file = file_of(map);
  return file ? (*file)->rename(name) : tl::unexpected(file.error());
}

Status Store::tag(MapId map, MapTag tag) {
  const auto file = file_of(map);
  return file ? (*file)->tag(std::move(tag)) : tl::unexpected(file.error());
}

Result<std::vector<MapTag>> Store::tags(MapId map) {
  const auto file = file_of(map);
  return file ? (*file)->tags() : tl::unexpected(file.error());
}

Status Store::untag(MapId map, const std::string& name) {
  const auto file = file_of(map);
  return file ? (*file)->untag(name) : tl::unexpected(file.error());
}

Result<MapTag> Store::find_tag(MapId map, const std::string& name) {
  const auto file = file_of(map);
  return file ? (*file)->find_tag(name) : tl::unexpected(file.error());
}

Status Store::roll_back(MapId map, const std::string& name, MapTag before, const AcceptState& accept) {
  auto file = open_own(map);
  if (!file) return tl::unexpected(file.error());
  const auto tags = file->tags();
  if (!tags) return tl::unexpected(tags.error());
  before.name = free_name(*tags);
  const auto epoch = next_epoch(map, file->header().epoch);
  if (!epoch) return tl::unexpected(epoch.error());
  return file->roll_back(name, std::move(before), *epoch, accept);
}

Result<std::vector<ImageRow>> Store::read_images(MapId map, std::span<const KeyframeId> keyframes,
                                                 size_t enough_bytes) {
  const auto file = file_of(map);
  return file ? (*file)->read_images(keyframes, enough_bytes) : tl::unexpected(file.error());
}

Result<KeptProposal> Store::read_proposal(MapId map, uint64_t number) {
  const auto file = file_of(map);
  return file ? (*file)->read_proposal(number) : tl::unexpected(file.error());
}

Status Store::remove(MapId map) {
  close(map);
  if (!is_there(path_of(map))) {
    if (is_there(deleted_path_of(map))) return {};
    return fail(ErrorCode::kNotFound, "no map " + to_hex(map.bytes));
  }
  Status moved = put_in_place(path_of(map), deleted_path_of(map));
  std::error_code ignored;  // when it was deleted; without, it counts from its last change
  if (moved) fs::last_write_time(deleted_path_of(map), fs::file_time_type::clock::now(), ignored);
  return moved;
}

Status Store::undelete(MapId map) {
  if (is_there(path_of(map))) return {};
  if (!is_there(deleted_path_of(map))) {
    return fail(ErrorCode::kNotFound, "no deleted map " + to_hex(map.bytes));
  }
  return put_in_place(deleted_path_of(map), path_of(map));
}

Status Store::purge(MapId map) {
  Status removed = remove_database(deleted_path_of(map));
  if (removed) sync_folder(folder_ / "deleted");
  return removed;
}

Status Store::undo_undelete(MapId map) {
  close(map);
  return put_in_place(path_of(map), deleted_path_of(map));
}

Status Store::undo_import(MapId map) {
  close(map);
  Status removed = remove_database(path_of(map));
  if (removed) sync_folder(folder_ / "maps");
  return removed;
}

Status Store::probe() const {
  const fs::path path = folder_ / "probe";
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0640);
  if (descriptor < 0) return io_failure(path, std::strerror(errno));
  const std::vector<uint8_t> bytes(kProbeBytes, 1);
  Status written = write_all(descriptor, bytes);
  if (written && ::fsync(descriptor) != 0)
    written = fail(ErrorCode::kIo, std::string("cannot be written: ") + std::strerror(errno));
  ::close(descriptor);
  std::error_code ignored;
  fs::remove(path, ignored);
  return written ? written : io_failure(folder_, "takes nothing more: it " + written.error().message);
}

Result<fs::path> Store::set_aside(MapId map, const std::string& name,
                                  const std::vector<std::string>& reasons) {
  close(map);
  const fs::path aside = free_path(folder_ / "damaged", to_hex(map.bytes) + "-" + utc_stamp(), kMapSuffix);
  if (Status moved = move_database(path_of(map), aside); !moved) return tl::unexpected(moved.error());
  write_reasons(aside, name, reasons);
  return aside;
}

Result<fs::path> Store::replace(const MapHeader& header, const MapUpdate& saved,
                                const std::vector<std::string>& reasons) {
  const fs::path fresh = fresh_path_of(header.id);
  if (Status made = make_file(fresh, header, saved); !made) return tl::unexpected(made.error());
  // From here on it comes into its place wherever the server ends.
  const fs::path whole = saved_path_of(header.id);
  if (Status moved = move_database(fresh, whole); !moved) return tl::unexpected(moved.error());
  auto aside = set_aside(header.id, header.name, reasons);
  if (!aside) return aside;
  if (Status moved = put_in_place(whole, path_of(header.id)); !moved) return tl::unexpected(moved.error());
  return aside;
}

Status Store::prepare_rewrite(const MapHeader& header, const MapUpdate& whole, MapFile* images,
                              const KeyframeIds& now, const AcceptState& accept) {
  const fs::path fresh = fresh_path_of(header.id);
  if (Status made = make_file(fresh, header, whole, images, now); !made) return made;
  Status done = show(fresh, accept);
  // From here on it is whole.
  if (done) done = move_database(fresh, saved_path_of(header.id));
  if (!done) discard_database(fresh);
  return done;
}

Status Store::show(const fs::path& path, const AcceptState& accept) {
  auto file = MapFile::open(path);
  if (!file) return tl::unexpected(file.error());
  const auto epoch = next_epoch(file->header().id, file->header().epoch);
  if (!epoch) return tl::unexpected(epoch.error());
  if (Status begun = file->begin_epoch(*epoch); !begun) return begun;
  return accept ? accept(file->load()) : Status();
}

/// If the server ends when the old file has been removed, the next start puts the new one in its place; if it
/// ends before, the map stays as it was.
Status Store::finish_rewrite(MapId map) const {
  if (Status removed = remove_database(path_of(map)); !removed) {
    discard_database(saved_path_of(map));
    return removed;
  }
  return put_in_place(saved_path_of(map), path_of(map));
}

Result<std::vector<Contribution>> Store::contributions(MapId map) {
  const auto file = file_of(map);
  return file ? (*file)->contributions() : tl::unexpected(file.error());
}

void Store::tidy() {
  for (OpenFile& open : open_files_) open.file.tidy();
}

}  // namespace cairn
