// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <limits>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/store/map_file.h"
#include "server/store/overlap_record.h"

namespace cairn {

/// A map that was deleted and can be had back.
struct DeletedMap {
  MapHeader header;
  Timestamp deleted;
  uint64_t bytes = 0;            ///< of its file
  std::optional<Error> problem;  ///< why its file cannot be used (kDamaged) or read now; the id is known then
};

/// Decisions on a map that was deleted since: the one on its seed, and the last of the rest.
struct DeletedDecisions {
  MapHeader header;
  std::vector<DecisionRecord> decisions;
};

/// A file that could not be used as it was, or a log whose file is not known, out of the way in the folder
/// `damaged`.
struct DamagedFile {
  std::filesystem::path path;
  MapId map;         ///< none: it is no map's
  std::string name;  ///< of the map, where it could be read
  Timestamp set_aside;
  uint64_t bytes = 0;
  std::vector<std::string> reasons;
};

/// A map that is not served since its file could not be loaded, or not be put into its place, which need not
/// be the file's fault: it lies where it was.
struct UnloadedMap {
  MapId map;
  std::string name;  ///< where it could be read
  std::filesystem::path file;
  std::string reason;
};

/// A folder with all that a server keeps (README.md): a file for each map, and a catalogue of what belongs to
/// the server itself. A plain class, one thread at a time, but for what is marked.
class Store {
 public:
  /// Opens the folder, or makes it, and counts a start of the server. A damaged catalogue is set aside and
  /// begun anew: maps do not depend on it. Errors: kRefused (another server uses it), kIo.
  [[nodiscard]] static Result<std::unique_ptr<Store>> open(const std::filesystem::path& folder, Logger log);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// Id of the server, the same through all starts.
  [[nodiscard]] ServerId server() const { return server_; }
  /// Number of this start: larger at every start, and not below the wall clock [ms]. It is later than any
  /// epoch in which a map has been served from here, whatever has become of it, and of a backup or a
  /// catalogue that was lost.
  [[nodiscard]] uint64_t start_count() const { return start_count_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

  /// Maps that are in use, ascending. Each was whole once: what a server that ended had begun to make is
  /// removed at the start.
  [[nodiscard]] std::vector<MapId> maps() const;
  /// Ids of deleted maps, ascending; they are not given again.
  [[nodiscard]] std::vector<MapId> deleted_ids() const;
  /// Deleted maps with what they were, those that cannot be used among them, the latest deleted first. Opens
  /// each file, and writes nothing: to purge one must be possible on a full disk.
  [[nodiscard]] std::vector<DeletedMap> deleted_maps() const;

  /// Decisions on the `maps` maps that were deleted last, as far as their files can be read. They are those
  /// of MapFile::read_decisions() with `newest`.
  [[nodiscard]] std::vector<DeletedDecisions> decisions_on_deleted(size_t maps, int64_t newest) const;

  /// Maps whose place could not be taken at the start by what had been saved of them: none of maps().
  [[nodiscard]] const std::vector<UnloadedMap>& unplaced() const { return unplaced_; }

  /// Files that have been set aside and that nobody has taken away, by id and time. By any thread.
  [[nodiscard]] std::vector<DamagedFile> damaged_files() const;

  /// Path of the file of a map in use. By any thread.
  [[nodiscard]] std::filesystem::path path_of(MapId map) const;

  /// Reads all of a map and begins a new epoch of it, which is persisted: later than those of the file, and
  /// than any in which a map of that id has been served from here, be it that another copy of it was deleted
  /// and purged. Rows of proposals that are damaged are left out; unless the rest is damaged, too, they are
  /// removed and named in the log. Different maps may be loaded at the same time, by any thread. Errors: as
  /// MapFile::open().
  [[nodiscard]] Result<StoredMap> load(MapId map);

  /// Adds a map. Error kRefused when its id is in use; nothing that is there is overwritten.
  [[nodiscard]] Status create(const MapHeader& header, const MapUpdate& whole);
  /// Writes updates of a map as MapFile::write() does.
  [[nodiscard]] Status write(MapId map, std::span<const MapUpdate> updates);
  [[nodiscard]] Status rename(MapId map, const std::string& name);
  /// These four do what MapFile's do.
  [[nodiscard]] Status tag(MapId map, MapTag tag);
  [[nodiscard]] Result<std::vector<MapTag>> tags(MapId map);
  [[nodiscard]] Status untag(MapId map, const std::string& name);
  [[nodiscard]] Result<MapTag> find_tag(MapId map, const std::string& name);
  /// Rolls a map back as MapFile::roll_back() does, in a later epoch, as load() begins one. `before` is
  /// called before-rollback-N. Uses a connection of its own, beside the thread that writes other maps.
  /// Precondition: close() was called, and nobody writes this map.
  [[nodiscard]] Status roll_back(MapId map, const std::string& name, MapTag before,
                                 const AcceptState& accept);
  /// Says in the log which proposals could not be read of a map that goes on without them.
  void note_lost_proposals(MapId map, const StoredMap& read) const;
  /// Closes the map's file, which another connection is about to change or has changed: it is opened anew
  /// when it is needed.
  void close(MapId map);
  /// Reads images of a map as MapFile::read_images() does.
  [[nodiscard]] Result<std::vector<ImageRow>> read_images(MapId map, std::span<const KeyframeId> keyframes,
                                                          size_t enough_bytes);
  /// Reads a proposal to a map as MapFile::read_proposal() does.
  [[nodiscard]] Result<KeptProposal> read_proposal(MapId map, uint64_t number);
  /// Moves a map to the deleted ones and back. Idempotent. Error kNotFound for a map that is in neither
  /// place. An error leaves it where it was.
  [[nodiscard]] Status remove(MapId map);
  [[nodiscard]] Status undelete(MapId map);
  /// Removes a deleted map for good. Idempotent. An error leaves it as it was.
  [[nodiscard]] Status purge(MapId map);
  /// These undo undelete() and import_map(), when the map cannot be served after all.
  [[nodiscard]] Status undo_undelete(MapId map);
  [[nodiscard]] Status undo_import(MapId map);

  /// Maps that have a place in common, as last kept before this start; deleted ones, too.
  [[nodiscard]] const std::vector<OverlapRecord>& overlaps() const { return overlaps_; }
  /// Keeps these overlaps, in place of all that was kept before.
  [[nodiscard]] Status keep_overlaps(std::span<const OverlapRecord> overlaps) const;

  /// Whether the folder takes what a keyframe needs. Error kIo: it does not.
  [[nodiscard]] Status probe() const;

  /// Moves the file of a map that cannot be used to the folder `damaged`, with the name of the map, as far as
  /// it is known, and the reasons beside it. Returns the path under which it is kept.
  [[nodiscard]] Result<std::filesystem::path> set_aside(MapId map, const std::string& name,
                                                        const std::vector<std::string>& reasons);
  /// Sets a damaged map aside and puts what could be saved of it in its place, whole or not at all.
  [[nodiscard]] Result<std::filesystem::path> replace(const MapHeader& header, const MapUpdate& saved,
                                                      const std::vector<std::string>& reasons);

  /// Makes a consistent copy in one file, over a connection of its own: beside the thread that writes the
  /// map, but not while it is removed. `path` must not exist. What was proposed to the map stays here.
  [[nodiscard]] Status export_map(MapId map, const std::filesystem::path& path) const;
  /// Reads the contributions to a map as MapFile::contributions() does.
  [[nodiscard]] Result<std::vector<Contribution>> contributions(MapId map);
  /// These give a map's file other content, without tags, in two steps. The first makes the new file whole
  /// beside the map, in an epoch as of load(), and shows it to `accept`; if that does not accept, nothing has
  /// happened. The second puts it into the map's place. `images` are those of another file, under the ids
  /// that they have `now`; that file is closed before the second step. As roll_back() beside the thread that
  /// writes other maps.
  [[nodiscard]] Status prepare_rewrite(const MapHeader& header, const MapUpdate& whole, MapFile* images,
                                       const KeyframeIds& now, const AcceptState& accept);
  [[nodiscard]] Status finish_rewrite(MapId map) const;
  /// Makes a map of its own that is like another, without its tags, decisions and proposals, under an id that
  /// is free. Uses a connection of its own, as export_map() does.
  [[nodiscard]] Status copy_map(MapId map, MapId copy, const std::string& name) const;
  /// Takes in the copy of an archive, without its tags, decisions and proposals, after a look at every row of
  /// it. Returns the id that it brings. Its images are decoded one after another. kRefused when the id is in
  /// use (it says by which file) or the images take more than `most_image_bytes` as decoded, kDamaged when
  /// anything in it is damaged; what it says of the archive names no path of ours. Beside the thread that
  /// writes maps.
  [[nodiscard]] Result<MapId> import_map(
      const std::filesystem::path& archive,
      uint64_t most_image_bytes = std::numeric_limits<uint64_t>::max()) const;

  /// Housekeeping of the open files; some ten milliseconds when there is any.
  void tidy();

 private:
  struct Lock;
  struct OpenFile {
    MapId map;
    MapFile file;
  };
  Store(std::filesystem::path folder, std::unique_ptr<Lock> lock, Logger log);
  [[nodiscard]] Status part_with_lone_logs(const char* part) const;
  /// Moves a log that lies alone to its file, or to `damaged`.
  [[nodiscard]] Status part_with_lone_log(const std::filesystem::path& log) const;
  /// The file of a log that lies alone, wherever the file has been moved to; nothing if it is not known.
  [[nodiscard]] std::optional<std::filesystem::path> moved_file_of(const std::filesystem::path& log) const;
  /// Moves a file with its companions to where a map's file belongs. A log that lies alone there is moved
  /// away first, since SQLite would take it for that of this file. Errors: kRefused (there is a file), kIo.
  [[nodiscard]] Status put_in_place(const std::filesystem::path& from, const std::filesystem::path& to) const;
  [[nodiscard]] Status finish_replacements();
  [[nodiscard]] Status open_catalogue();
  [[nodiscard]] Status read_catalogue();
  /// The epoch in which a map is to be served whose file says that it was last served in another.
  [[nodiscard]] Result<Epoch> next_epoch(MapId map, Epoch last_of_file);
  /// Keeps that this epoch has been given.
  [[nodiscard]] Status keep_last_epoch(uint64_t epoch) const;
  [[nodiscard]] Status put_server(sqlite::Database* catalogue, uint64_t last_epoch) const;
  [[nodiscard]] std::filesystem::path catalogue_path() const;
  void read_overlaps(sqlite::Database* catalogue);
  [[nodiscard]] std::filesystem::path deleted_path_of(MapId map) const;
  [[nodiscard]] std::filesystem::path fresh_path_of(MapId map) const;
  [[nodiscard]] std::filesystem::path saved_path_of(MapId map) const;
  /// Checks that no file has the id of a map. Error kRefused, with the file that has it.
  [[nodiscard]] Status check_is_free(const MapHeader& header) const;
  [[nodiscard]] Result<MapId> take_in(MapFile* archive, uint64_t most_image_bytes) const;
  /// Makes the file of a map in its place. `images`: of another file, beside those of `whole`.
  [[nodiscard]] Status make(const MapHeader& header, const MapUpdate& whole, MapFile* images = nullptr) const;
  [[nodiscard]] Result<MapFile*> file_of(MapId map);
  /// Begins a new epoch of the map in a file, and shows the map to `accept`.
  [[nodiscard]] Status show(const std::filesystem::path& path, const AcceptState& accept);
  /// Opens a map's file over another connection. Errors: as MapFile::open(); kDamaged: it is another map's.
  [[nodiscard]] Result<MapFile> open_own(MapId map) const;
  void keep_open(MapId map, MapFile file);

  std::filesystem::path folder_;
  std::unique_ptr<Lock> lock_;
  Logger log_;
  ServerId server_;
  uint64_t start_count_ = 0;
  std::mutex epochs_mutex_;     ///< of what follows
  uint64_t last_epoch_ = 0;     ///< given to any map, the start included
  std::set<MapId> not_loaded_;  ///< maps that were there at the start and are not loaded yet
  std::vector<OverlapRecord> overlaps_;
  std::vector<UnloadedMap> unplaced_;
  std::list<OpenFile> open_files_;  ///< the one used last in front
};

/// Reads all of an archive, and brings the file to the present schema.
[[nodiscard]] Result<StoredMap> read_archive(const std::filesystem::path& path);

}  // namespace cairn
