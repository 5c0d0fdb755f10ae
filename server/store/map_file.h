// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/map/ids.h"
#include "common/map/label.h"
#include "server/mapping/map_record.h"
#include "server/store/proposal.h"
#include "server/store/sqlite.h"

namespace cairn {

/// The header of a map file: what it says of itself.
struct MapHeader {
  MapId id;
  std::string name;
  Epoch epoch;  ///< the last one under which the map was served
  bool metric = false;
  Timestamp created;
};

enum class CommandKind : uint8_t { kSeed = 0, kOffer = 1, kRequest = 2, kLast = kRequest };

/// The server's word on a client's command, kept with the map that it concerns: a command that is sent again
/// after a restart is answered, not carried out twice.
struct DecisionRecord {
  std::string client;  ///< name
  SessionId session;
  uint64_t seq = 0;
  CommandKind kind = CommandKind::kOffer;
  /// wire::OfferDecision or wire::RequestDecision; of a seed that was accepted, 0
  uint8_t decision = 0;
  std::string reason;
  KeyframeId keyframe;  ///< when accepted
  Timestamp time;
  std::vector<std::pair<TrailId, PointId>> seed_points;  ///< of a seed
  uint64_t label = 0;                                    ///< of a request
};

/// Things said of a place in the map (topic Label).
struct LabelRecord {
  uint64_t id = 0;  ///< unique in the map, from 1
  std::string text;
  SE3 map_from_label;  ///< when it was written: for when the anchor is not there
  std::string author;
  Timestamp time;
  LabelKind kind = LabelKind::kText;
  KeyframeId anchor{};      ///< that it sticks to
  SE3 anchor_from_label{};  ///< that keyframe's camera from the label
};

/// An epoch and how many ids meant the same in the one before it: what an earlier epoch called by a higher id
/// was lost with the server that gave it out, or rolled back, and has another meaning now.
struct EpochRecord {
  Epoch epoch;
  size_t keyframes = 0;
  size_t points = 0;
};

/// A keyframe and the name of the client that offered it.
using Contribution = std::pair<KeyframeId, std::string>;

/// Changes that are written at a time: all of them or none. A keyframe that was accepted is its client's
/// contribution, too.
struct MapUpdate {
  MapRecord record;
  std::vector<DecisionRecord> decisions;
  std::vector<LabelRecord> labels;  ///< new or changed
  std::vector<uint64_t> removed_labels;
  std::vector<Contribution> contributions = {};  ///< beside those in `decisions`
  std::vector<KeptProposal> proposals = {};      ///< new ones
  std::vector<uint64_t> removed_proposals = {};
  uint64_t last_proposal = 0;  ///< the highest number ever given, beside those of `proposals`
};

/// A state of the map that can be had back.
struct MapTag {
  uint64_t number = 0;  ///< from 1, later ones higher
  std::string name;     ///< one of the map's tags is called so
  Timestamp time;       ///< of the wall clock
  std::string author;
  size_t keyframes = 0;  ///< live then
  size_t points = 0;
  size_t keyframe_count = 0;  ///< ever made then; filled in by tag()
  size_t point_count = 0;
  Epoch epoch{};  ///< in which it was made; filled in by tag(). 0: an earlier version made it
};

/// All of a map file.
struct StoredMap {
  MapHeader header;
  MapRecord record;
  std::vector<EpochRecord> epochs;  ///< ascending
  std::vector<DecisionRecord> decisions;
  std::vector<LabelRecord> labels;
  std::vector<Contribution> contributions;
  std::vector<ProposalSummary> proposals;
  uint64_t last_proposal = 0;       ///< the highest number that was given to one
  std::vector<std::string> damage;  ///< rows and tables that could not be read, named; not part of the rest
  std::vector<std::string> lost_proposals = {};  ///< likewise, of proposals: the map is whole without them
};

/// An image as it stands in the file, with a sound checksum: decode_image_row().
struct ImageRow {
  KeyframeId keyframe;
  std::vector<uint8_t> data;
};

/// Whether the images are among what is loaded: they are most of a map, and many times larger than their
/// rows.
enum class LoadedImages : uint8_t {
  kAll,
  kNone,
  kDecodedOnly,  ///< each is decoded, and one of its size stands for it: to check, not to use
};

/// A function that is shown all of a map as it would become. If it returns an error, the map stays as it is.
using AcceptState = std::function<Status(StoredMap state)>;

/// Origin of a file: one of our own making, or one that somebody has brought, of which nothing is believed.
enum class FileOrigin : uint8_t { kOwn, kElsewhere };

/// Whether a server has the file, and may move it.
enum class FileInUse : uint8_t { kNo, kYes };

/// Maps the old id of a keyframe to the one that it has now. Empty: ids are as before.
using KeyframeIds = std::function<KeyframeId(KeyframeId before)>;

/// One map in one SQLite file, which is also the archive of `cairnctl maps export`. Every row is a key, a
/// blob (row_codec.h) and a CRC-32 of both; the schema is in FORMAT.md. A plain class, one thread at a time.
class MapFile {
 public:
  /// Makes the file with its first content, or nothing.
  [[nodiscard]] static Result<MapFile> create(const std::filesystem::path& path, const MapHeader& header,
                                              const MapUpdate& content);
  /// Opens a file and brings it to the present schema. Errors: kNotFound (no file), kDamaged (an empty one,
  /// too: it is left as it is, with its log), kConfiguration (written by a newer version), kIo.
  [[nodiscard]] static Result<MapFile> open(const std::filesystem::path& path,
                                            FileOrigin origin = FileOrigin::kOwn,
                                            FileInUse in_use = FileInUse::kNo);

  /// The header of a file that nobody has open, without writing anything where its log is empty. Errors: as
  /// open().
  [[nodiscard]] static Result<MapHeader> read_header(const std::filesystem::path& path);
  /// Reads the decisions alone, as read_header() does: the first one, which is the seed's, and the `newest`
  /// last. Rows that are damaged are left out.
  [[nodiscard]] static Result<std::vector<DecisionRecord>> read_decisions(const std::filesystem::path& path,
                                                                          int64_t newest);

  [[nodiscard]] const MapHeader& header() const { return header_; }

  /// Writes updates in their order, in one transaction: on return they are durable, or none is.
  [[nodiscard]] Status write(std::span<const MapUpdate> updates);
  [[nodiscard]] Status rename(const std::string& name);
  /// Persists a new epoch, later than all before it.
  [[nodiscard]] Status begin_epoch(Epoch epoch);
  /// Makes a tag: the present state can be had back from now on. It costs nothing then; afterwards each row
  /// that changes is kept once as it was. Error kRefused: there is a tag of that name, or there are too many.
  [[nodiscard]] Status tag(MapTag tag);
  /// The client of each keyframe, ascending; also of keyframes that were removed since. Error kDamaged.
  [[nodiscard]] Result<std::vector<Contribution>> contributions();
  /// The tags, in the order in which they were made. Error kDamaged.
  [[nodiscard]] Result<std::vector<MapTag>> tags();
  /// Forgets a tag and what only it needed. Error kNotFound.
  [[nodiscard]] Status untag(const std::string& name);
  /// The tag of that name. Error kNotFound.
  [[nodiscard]] Result<MapTag> find_tag(const std::string& name);
  /// Brings everything back as it was when the tag was made, but for the map's name and epochs, the decisions
  /// and the tags, of which there is one more, `before`, for the present state. Ids that were given since
  /// have another meaning from then on, so this begins `epoch`. Durable on return, or nothing has happened.
  /// Errors: kNotFound, kRefused (as of tag()), kDamaged, those of `accept`.
  [[nodiscard]] Status roll_back(const std::string& name, MapTag before, Epoch epoch,
                                 const AcceptState& accept = {});
  /// Reads beside one that writes the file: all that is read while the result lives is as of now, header()
  /// too.
  [[nodiscard]] Result<sqlite::Reading> read_as_of_now();
  /// A keyframe that was kept aside. Error kDamaged: it is missing, or damaged.
  [[nodiscard]] Result<KeptProposal> read_proposal(uint64_t number);
  /// Removes the rows of proposals that could not be read; their numbers are not given again. `read`: by
  /// load().
  [[nodiscard]] Status forget_lost_proposals(const StoredMap& read);
  /// Checks the images of all proposals. Returns what is wrong.
  [[nodiscard]] std::vector<std::string> check_proposals();
  /// Removes all proposals, and what they showed from the file: for one that leaves the server.
  [[nodiscard]] Status erase_proposals();
  /// Reads everything; what is damaged is named and left out.
  [[nodiscard]] StoredMap load(LoadedImages images = LoadedImages::kAll);
  /// Checks what only tags need. Returns what is damaged.
  [[nodiscard]] std::vector<std::string> check_tags();
  /// Decodes each image, one after another. Errors: kRefused (together they take more than `most_bytes`, one
  /// for each pixel; none is decoded then), kDamaged (the first row that is).
  [[nodiscard]] Status check_images(uint64_t most_bytes);
  /// Takes over the images of another file as they stand there, one after another; they are durable with the
  /// next write_back(). `now`: under which ids; those without one stay behind.
  [[nodiscard]] Status take_images(MapFile* from, const KeyframeIds& now = {});
  /// The images of some keyframes, in their order, until there are `enough_bytes`; one at least. Error
  /// kDamaged: the first row that is missing or damaged.
  [[nodiscard]] Result<std::vector<ImageRow>> read_images(std::span<const KeyframeId> keyframes,
                                                          size_t enough_bytes);
  /// A copy in one file, consistent and compact. `path` must not exist.
  [[nodiscard]] Status copy_to(const std::filesystem::path& path);
  /// Writes the log back to the file, so that the file alone is all of it. Error kIo; nothing is lost then.
  [[nodiscard]] Status write_back() { return database_.checkpoint(); }
  /// write_back() once the log is long. To be called after answers have gone out: it takes some ten
  /// milliseconds.
  void tidy();

 private:
  MapFile(sqlite::Database database, MapHeader header)
      : database_(std::move(database)), header_(std::move(header)) {}
  [[nodiscard]] Status put(const MapUpdate& update);
  [[nodiscard]] Status put(std::string_view table, int64_t id, std::span<const uint8_t> data);
  [[nodiscard]] Status remove(std::string_view table, int64_t id);
  [[nodiscard]] Status put_header();
  [[nodiscard]] Status learn_header();
  [[nodiscard]] Status put_epoch(const EpochRecord& epoch);
  // Proposals (map_proposals.cpp).
  [[nodiscard]] Status put_proposals(const MapUpdate& update);
  void load_proposals(StoredMap* map);
  // Tags (map_versions.cpp).
  [[nodiscard]] Status learn_newest_tag();
  /// Keeps a row as it is for the newest tag, before it changes.
  [[nodiscard]] Status keep_as_tagged(std::string_view table, int64_t id);
  [[nodiscard]] Status put_back(uint64_t tag);
  /// Rolls back within a transaction that the caller has begun.
  [[nodiscard]] Status replace_by(const MapTag& tag, MapTag before, Epoch epoch, const AcceptState& accept);
  /// The epoch that begins with the state of a tag.
  [[nodiscard]] Result<EpochRecord> epoch_after(const MapTag& tag, Epoch epoch);
  /// Removes from decisions the ids of keyframes that are no more.
  [[nodiscard]] Status forget_keyframes_beyond(size_t count);
  /// Error kDamaged: it is missing, or damaged.
  [[nodiscard]] Result<std::vector<uint8_t>> read_row(std::string_view table, int64_t id);
  [[nodiscard]] Result<int64_t> camera_row(const CameraParameters& camera);
  [[nodiscard]] Status learn_cameras();
  [[nodiscard]] Status learn_contributors();
  void load_contributions(StoredMap* map);
  /// Shows each image's keyframe and row to `use`, which says whether it is one. Error kDamaged: the first
  /// that is not.
  [[nodiscard]] Status for_each_image(
      const std::function<bool(KeyframeId keyframe, std::span<const uint8_t> row)>& use);
  /// Loads the cameras, by their row in the file.
  [[nodiscard]] std::map<int64_t, CameraPtr> load_cameras(std::vector<std::string>* damage);
  [[nodiscard]] Result<sqlite::Statement*> statement(std::string_view sql);

  sqlite::Database database_;
  MapHeader header_;
  size_t keyframe_count_ = 0;
  size_t point_count_ = 0;
  uint64_t newest_tag_ = 0;                                           ///< 0: none
  std::vector<std::pair<CameraParameters, int64_t>> cameras_;         ///< rows
  std::map<std::string, sqlite::Statement, std::less<>> statements_;  ///< by SQL; go before the database
};

/// Whether a file begins as a map file does, without opening it as one, which writes. Errors, without its
/// path: kDamaged, kNotFound, kIo.
[[nodiscard]] Status check_is_map_file(const std::filesystem::path& path);

/// The version of the schema that this program writes.
[[nodiscard]] int map_schema_version();

}  // namespace cairn
