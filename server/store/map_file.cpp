// SPDX-License-Identifier: Apache-2.0
#include "server/store/map_file.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "common/image/limits.h"
#include "common/io/image_header.h"
#include "common/map/limits.h"
#include "server/store/database_files.h"
#include "server/store/entry_codec.h"
#include "server/store/row_codec.h"
#include "server/store/rows.h"
#include "server/store/schema.h"

namespace cairn {
namespace {

constexpr int kLongLog = 1000;  ///< [pages of 4 kB] from which tidy() writes it back
constexpr int64_t kDecisionsKept = 10'000;
constexpr int64_t kFirstDecision = 1;  ///< on the seed: it stays, and with it who made the map
constexpr int kSchemaWithContributors = 8;

/// Rows of table map.
enum MapRow : int64_t { kHeaderRow = 1, kFoundationRow = 2, kWorkRow = 3 };

bool is_item(int64_t id, size_t count) {
  return id >= 1 && static_cast<uint64_t>(id) <= count;
}

Result<sqlite::Database> open_database(const std::filesystem::path& path, sqlite::OpenMode mode) {
  // To SQLite it would be a new database, whose log goes.
  std::error_code ignored;
  if (std::filesystem::file_size(path, ignored) == 0)
    return fail(ErrorCode::kDamaged, path.string() + ": cut to 0 bytes");
  return sqlite::Database::open(path, mode);
}

Result<int> version_of(sqlite::Database* database) {
  auto version = schema_version(database, map_schema());
  if (version && *version == 0)
    return fail(ErrorCode::kDamaged, database->path() + ": holds no table of a map");
  return version;
}

/// Another connection may be about to do the same.
Status bring_up_to_date(sqlite::Database* database) {
  auto transaction = sqlite::Transaction::begin(database);
  if (!transaction) return tl::unexpected(transaction.error());
  const auto version = version_of(database);
  if (!version) return tl::unexpected(version.error());
  Status done = migrate(database, map_schema(), *version, map_schema_version());
  return done ? transaction->commit() : done;
}

Result<CountedHeader> header_of(sqlite::Database* database) {
  std::optional<CountedHeader> header;
  std::vector<std::string> damage;
  read_rows(
      database, "map",
      [&](int64_t id, std::span<const uint8_t> data) {
        if (id == kHeaderRow) header = decode_header(data);
        return true;
      },
      &damage);
  if (header) return std::move(*header);
  return fail(ErrorCode::kDamaged,
              database->path() + ": " + (damage.empty() ? "it does not say what it is" : damage.front()));
}

}  // namespace

Status check_is_map_file(const std::filesystem::path& path) {
  // SQLite's documented header: its name at 0, the application's number at 68, the high byte first.
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  constexpr size_t kApplicationAt = 68;
  constexpr size_t kHeaderBytes = 100;
  std::error_code unknown;
  const bool is_stream = std::filesystem::exists(path, unknown) &&
                         !std::filesystem::is_regular_file(path, unknown) &&
                         !std::filesystem::is_directory(path, unknown);
  if (is_stream) return fail(ErrorCode::kIo, "not a regular file; copy what comes out of it to one");
  errno = 0;  // a stream keeps it, and says nothing else
  std::ifstream in(path, std::ios::binary);
  std::array<char, kHeaderBytes> header{};
  in.read(header.data(), header.size());
  if (!in && !in.eof()) {
    const ErrorCode code = errno == ENOENT ? ErrorCode::kNotFound : ErrorCode::kIo;
    return fail(code, std::string("cannot be read: ") + std::strerror(errno));
  }
  uint32_t application = 0;
  for (size_t i = 0; i < sizeof(application); ++i)
    application = application << 8 | static_cast<uint8_t>(header[kApplicationAt + i]);
  if (std::string_view(header.data(), kMagic.size()) == kMagic &&
      application == static_cast<uint32_t>(map_schema().application_id))
    return {};
  return fail(ErrorCode::kDamaged, "not an archive of a map (`cairnctl maps export` writes them)");
}

int map_schema_version() {
  return static_cast<int>(map_schema().steps.size());
}

Result<MapFile> MapFile::create(const std::filesystem::path& path, const MapHeader& header,
                                const MapUpdate& content) {
  auto database = sqlite::Database::open(path, sqlite::OpenMode::kCreate);
  if (!database) return tl::unexpected(database.error());
  MapFile file(std::move(*database), header);
  auto transaction = sqlite::Transaction::begin(&file.database_);
  if (!transaction) return tl::unexpected(transaction.error());
  Status done = migrate(&file.database_, map_schema(), 0, map_schema_version());
  if (done) done = file.put(content);
  if (done)
    done = file.put("epochs", static_cast<int64_t>(header.epoch.value), encode_epoch({header.epoch, 0, 0}));
  if (done) done = file.put_header();
  if (done) done = transaction->commit();
  if (!done) return tl::unexpected(done.error());
  return file;
}

Result<MapFile> MapFile::open(const std::filesystem::path& path, FileOrigin origin, FileInUse in_use) {
  auto database = open_database(
      path, in_use == FileInUse::kYes ? sqlite::OpenMode::kBeside : sqlite::OpenMode::kReadWrite);
  if (!database) return tl::unexpected(database.error());
  const auto version = version_of(&*database);
  if (!version) return tl::unexpected(version.error());
  if (origin == FileOrigin::kElsewhere) {
    if (Status sound = check_schema(&*database, map_schema(), *version); !sound)
      return tl::unexpected(sound.error());
  }
  const bool lacks_contributors = *version < kSchemaWithContributors;
  if (*version < map_schema_version()) {
    if (Status done = bring_up_to_date(&*database); !done) return tl::unexpected(done.error());
  }
  MapFile file(std::move(*database), {});
  if (Status learnt = file.learn_header(); !learnt) return tl::unexpected(learnt.error());
  if (lacks_contributors) {
    if (Status known = file.learn_contributors(); !known) return tl::unexpected(known.error());
  }
  return file;
}

Status MapFile::learn_header() {
  auto header = header_of(&database_);
  if (!header) return tl::unexpected(header.error());
  header_ = std::move(header->header);
  keyframe_count_ = header->keyframes;
  point_count_ = header->points;
  return learn_newest_tag();
}

Result<sqlite::Reading> MapFile::read_as_of_now() {
  auto reading = sqlite::Reading::begin(&database_);
  if (!reading) return reading;
  if (Status learnt = learn_header(); !learnt) return tl::unexpected(learnt.error());
  return reading;
}

Result<MapHeader> MapFile::read_header(const std::filesystem::path& path) {
  auto database =
      open_database(path, has_log(path) ? sqlite::OpenMode::kReadWrite : sqlite::OpenMode::kAtRest);
  if (!database) return tl::unexpected(database.error());
  if (const auto version = version_of(&*database); !version) return tl::unexpected(version.error());
  auto header = header_of(&*database);
  return header ? Result<MapHeader>(std::move(header->header)) : tl::unexpected(header.error());
}

Result<std::vector<DecisionRecord>> MapFile::read_decisions(const std::filesystem::path& path,
                                                            int64_t newest) {
  auto database =
      open_database(path, has_log(path) ? sqlite::OpenMode::kReadWrite : sqlite::OpenMode::kAtRest);
  if (!database) return tl::unexpected(database.error());
  if (const auto version = version_of(&*database); !version) return tl::unexpected(version.error());
  std::vector<DecisionRecord> decisions;
  std::vector<std::string> damage;  // is told by who loads the map
  const auto read = [&](const std::string& which) {
    read_rows(
        &*database, "decisions",
        [&decisions](int64_t, std::span<const uint8_t> data) {
          auto decision = decode_decision(data);
          if (decision) decisions.push_back(std::move(*decision));
          return decision.has_value();
        },
        &damage, which);
  };
  // Two conditions, since SQLite walks the whole table for one that joins them by OR.
  const std::string first = std::to_string(kFirstDecision);
  read("id = " + first);
  read("id > max(" + first + ", (SELECT max(id) FROM decisions) - " + std::to_string(newest) + ")");
  return decisions;
}

// ---- writing

Status MapFile::write(std::span<const MapUpdate> updates) {
  const std::pair counts(keyframe_count_, point_count_);
  const auto cameras = cameras_;
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  Status done;
  for (const MapUpdate& update : updates) {
    if (done) done = put(update);
  }
  if (done) done = put_header();
  if (done) done = transaction->commit();
  if (!done) {
    std::tie(keyframe_count_, point_count_) = counts;
    cameras_ = cameras;
  }
  return done;
}

Status MapFile::put(const MapUpdate& update) {
  const MapRecord& r = update.record;
  Status done;
  const auto put_if_good = [&](std::string_view table, uint64_t id, const Blob& data) {
    if (done) done = put(table, static_cast<int64_t>(id), data);
  };
  if (r.keyframe_count > 0) {
    keyframe_count_ = r.keyframe_count;
    point_count_ = r.point_count;
  }
  if (r.foundation) put_if_good("map", kFoundationRow, encode_foundation(*r.foundation));
  if (r.work) put_if_good("map", kWorkRow, encode_work(*r.work));
  for (const CalibratedCameraRecord& c : r.calibrated_cameras) {
    if (done)
      done = put("cameras", calibrated_camera_row(c.index), encode_camera(c.camera.camera->parameters()));
    put_if_good("found_cameras", static_cast<uint64_t>(c.index) + 1, encode_calibrated_camera(c.camera));
  }
  for (const KeyframeRecord& k : r.keyframes) {
    const auto camera = k.estimated_camera >= 0 ? calibrated_camera_row(k.estimated_camera)
                                                : camera_row(k.camera->parameters());
    if (!camera) return tl::unexpected(camera.error());
    put_if_good("keyframes", k.id.value, encode_keyframe(k, *camera));
  }
  for (const ImageRecord& i : r.images) put_if_good("images", i.keyframe.value, encode_image_row(*i.image));
  for (const KeyframeId id : r.removed_images) {
    if (done) done = remove("images", static_cast<int64_t>(id.value));
  }
  for (const MeasurementsRecord& m : r.measurements)
    put_if_good("measurements", m.keyframe.value, encode_measurements(m));
  for (const SourcesRecord& s : r.sources) put_if_good("sources", s.block + 1, encode_sources(s));
  for (const PositionsRecord& p : r.positions) put_if_good("positions", p.block + 1, encode_positions(p));
  for (const DecisionRecord& d : update.decisions) {
    const auto last = database_.number("SELECT coalesce(max(id), 0) FROM decisions");
    if (!last) return tl::unexpected(last.error());
    put_if_good("decisions", static_cast<uint64_t>(*last + 1), encode_decision(d));
    const int64_t oldest = *last + 1 - kDecisionsKept;
    if (done && oldest > kFirstDecision) done = remove("decisions", oldest);
  }
  std::vector<Contribution> contributions = update.contributions;
  for (const DecisionRecord& d : update.decisions) {
    if (d.keyframe) contributions.emplace_back(d.keyframe, d.client);
    if (d.keyframe && d.kind == CommandKind::kSeed) contributions.emplace_back(KeyframeId{1}, d.client);
  }
  for (const auto& [keyframe, client] : contributions)
    put_if_good("contributors", keyframe.value, encode_contributor(client));
  for (const LabelRecord& l : update.labels) put_if_good("labels", l.id, encode_label(l));
  for (const uint64_t id : update.removed_labels) {
    if (done) done = remove("labels", static_cast<int64_t>(id));
  }
  return done ? put_proposals(update) : done;
}

Result<sqlite::Statement*> MapFile::statement(std::string_view sql) {
  const auto known = statements_.find(sql);
  if (known != statements_.end()) return &known->second;
  auto prepared = database_.prepare(sql);
  if (!prepared) return tl::unexpected(prepared.error());
  return &statements_.emplace(std::string(sql), std::move(*prepared)).first->second;
}

Status MapFile::put(std::string_view table, int64_t id, std::span<const uint8_t> data) {
  if (Status kept = keep_as_tagged(table, id); !kept) return kept;
  const auto insert = statement(put_row_sql(table));
  if (!insert) return tl::unexpected(insert.error());
  return (*insert)->bind(0, id).bind(1, data).bind(2, row_checksum(id, data)).run();
}

Status MapFile::remove(std::string_view table, int64_t id) {
  if (Status kept = keep_as_tagged(table, id); !kept) return kept;
  const auto erase = statement("DELETE FROM " + std::string(table) + " WHERE id = ?");
  if (!erase) return tl::unexpected(erase.error());
  return (*erase)->bind(0, id).run();
}

Status MapFile::put_header() {
  return put("map", kHeaderRow, encode_header({header_, keyframe_count_, point_count_}));
}

Result<int64_t> MapFile::camera_row(const CameraParameters& camera) {
  if (cameras_.empty()) {
    if (Status learnt = learn_cameras(); !learnt) return tl::unexpected(learnt.error());
  }
  int64_t last = 0;
  for (const auto& [parameters, row] : cameras_) {
    if (parameters == camera) return row;
    last = std::max(last, row);
  }
  if (Status done = put("cameras", last + 1, encode_camera(camera)); !done)
    return tl::unexpected(done.error());
  cameras_.emplace_back(camera, last + 1);
  return last + 1;
}

/// Fills in the contributors of a file from before they were kept, as far as its decisions say.
Status MapFile::learn_contributors() {
  MapUpdate known;
  std::vector<std::string> damage;  // is told by who loads the map
  read_rows(
      &database_, "decisions",
      [&known](int64_t, std::span<const uint8_t> data) {
        const auto decision = decode_decision(data);
        if (!decision) return false;
        if (decision->keyframe) known.contributions.emplace_back(decision->keyframe, decision->client);
        if (decision->keyframe && decision->kind == CommandKind::kSeed)
          known.contributions.emplace_back(KeyframeId{1}, decision->client);
        return true;
      },
      &damage);
  return known.contributions.empty() ? Status() : write({&known, 1});
}

Result<std::vector<Contribution>> MapFile::contributions() {
  StoredMap map;
  load_contributions(&map);
  if (!map.damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + map.damage.front());
  return std::move(map.contributions);
}

void MapFile::load_contributions(StoredMap* map) {
  read_rows(
      &database_, "contributors",
      [&](int64_t id, std::span<const uint8_t> data) {
        auto client = is_item(id, keyframe_count_) ? decode_contributor(data) : std::nullopt;
        if (client)
          map->contributions.emplace_back(KeyframeId{static_cast<uint64_t>(id)}, std::move(*client));
        return client.has_value();
      },
      &map->damage);
}

Status MapFile::learn_cameras() {
  std::vector<std::string> damage;
  read_rows(
      &database_, "cameras",
      [&](int64_t id, std::span<const uint8_t> data) {
        auto camera = decode_camera(data);
        if (camera && id > 0) cameras_.emplace_back(std::move(*camera), id);
        return camera.has_value();
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + damage.front());
  return {};
}

Status MapFile::rename(const std::string& name) {
  const std::string before = std::exchange(header_.name, name);
  Status done = put_header();
  if (!done) header_.name = before;
  return done;
}

Status MapFile::begin_epoch(Epoch epoch) {
  const MapHeader before = header_;
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  Status done = put_epoch({epoch, keyframe_count_, point_count_});
  if (done) done = transaction->commit();
  if (!done) header_ = before;
  return done;
}

Status MapFile::put_epoch(const EpochRecord& epoch) {
  header_.epoch = epoch.epoch;
  Status done = put("epochs", static_cast<int64_t>(epoch.epoch.value), encode_epoch(epoch));
  return done ? put_header() : done;
}

Status MapFile::copy_to(const std::filesystem::path& path) {
  return database_.copy_to(path);
}

void MapFile::tidy() {
  if (database_.log_pages() > kLongLog) (void)write_back();  // nothing is lost; the next time comes
}

// ---- reading

CameraRows MapFile::load_cameras(std::vector<std::string>* damage) {
  CameraRows cameras;
  read_rows(
      &database_, "cameras",
      [&](int64_t id, std::span<const uint8_t> data) {
        const auto parameters = decode_camera(data);
        const auto camera =
            parameters ? make_camera(*parameters) : Result<CameraPtr>(fail(ErrorCode::kDamaged, "no camera"));
        if (camera) cameras[id] = *camera;
        return camera.has_value();
      },
      damage);
  return cameras;
}

Result<Blob> MapFile::read_row(std::string_view table, int64_t id) {
  const auto select = statement("SELECT data, checksum FROM " + std::string(table) + " WHERE id = ?");
  if (!select) return tl::unexpected(select.error());
  const std::string place =
      database_.path() + ": table " + std::string(table) + ", row " + std::to_string(id);
  Result<Blob> row = fail(ErrorCode::kDamaged, place + " is missing");
  const auto there = (*select)->bind(0, id).step();
  if (!there) {
    row = tl::unexpected(there.error());
  } else if (*there) {
    const auto data = (*select)->blob(0);
    row = Blob(data.begin(), data.end());
    if ((*select)->integer(1) != row_checksum(id, data))
      row = fail(ErrorCode::kDamaged, place + ": the checksum is wrong");
  }
  (*select)->reset();  // one that reads keeps the log from being written back
  return row;
}

Result<std::vector<ImageRow>> MapFile::read_images(std::span<const KeyframeId> keyframes,
                                                   size_t enough_bytes) {
  std::vector<ImageRow> rows;
  size_t bytes = 0;
  for (const KeyframeId keyframe : keyframes) {
    auto row = read_row("images", static_cast<int64_t>(keyframe.value));
    if (!row) return tl::unexpected(row.error());
    bytes += row->size();
    rows.push_back({keyframe, std::move(*row)});
    if (bytes >= enough_bytes) break;
  }
  return rows;
}

Status MapFile::for_each_image(
    const std::function<bool(KeyframeId keyframe, std::span<const uint8_t> row)>& use) {
  std::vector<std::string> damage;
  read_rows(
      &database_, "images",
      [&](int64_t id, std::span<const uint8_t> row) {
        return is_item(id, keyframe_count_) && use(KeyframeId{static_cast<uint64_t>(id)}, row);
      },
      &damage);
  if (!damage.empty()) return fail(ErrorCode::kDamaged, database_.path() + ": " + damage.front());
  return {};
}

Status MapFile::check_images(uint64_t most_bytes) {
  constexpr uint64_t kMegabyte = 1'000'000;
  uint64_t bytes = 0;
  const Status counted = for_each_image([&bytes](KeyframeId, std::span<const uint8_t> row) {
    const auto header = read_image_header(row);
    const bool is_image = header && header->width > 0 && header->width <= kMaxImageSide &&
                          header->height > 0 && header->height <= kMaxImageSide;
    if (is_image) bytes += static_cast<uint64_t>(header->width * header->height);
    return is_image;
  });
  if (!counted) return counted;
  if (bytes > most_bytes)
    return fail(ErrorCode::kRefused, "its images take " +
                                         std::to_string((bytes + kMegabyte - 1) / kMegabyte) +
                                         " MB in memory, and the server has room for " +
                                         std::to_string(most_bytes / kMegabyte) + " MB (--max-memory)");
  return for_each_image(
      [](KeyframeId, std::span<const uint8_t> row) { return decode_image_row(row) != nullptr; });
}

Status MapFile::take_images(MapFile* from, const KeyframeIds& now) {
  auto transaction = sqlite::Transaction::begin(&database_);
  if (!transaction) return tl::unexpected(transaction.error());
  Status done;
  const Status read = from->for_each_image([&](KeyframeId keyframe, std::span<const uint8_t> row) {
    const KeyframeId id = now ? now(keyframe) : keyframe;
    if (done && id) done = put("images", static_cast<int64_t>(id.value), row);
    return true;
  });
  if (done) done = read;
  return done ? transaction->commit() : done;
}

StoredMap MapFile::load(LoadedImages images) {
  StoredMap map;
  map.header = header_;
  map.record.keyframe_count = keyframe_count_;
  map.record.point_count = point_count_;
  MapRecord& r = map.record;
  const auto take = [&](std::string_view table, auto* rows, auto decode) {
    read_rows(
        &database_, table,
        [&](int64_t id, std::span<const uint8_t> data) {
          auto decoded = decode(id, data);
          if (decoded) rows->push_back(std::move(*decoded));
          return decoded.has_value();
        },
        &map.damage);
  };
  const CameraRows cameras = load_cameras(&map.damage);
  read_rows(
      &database_, "map",
      [&](int64_t id, std::span<const uint8_t> data) {
        if (id == kFoundationRow) return (r.foundation = decode_foundation(data)).has_value();
        if (id == kWorkRow) return (r.work = decode_work(data)).has_value();
        return id == kHeaderRow;
      },
      &map.damage);
  const auto keyframe_id = [this](int64_t id) {
    return is_item(id, keyframe_count_) ? KeyframeId{static_cast<uint64_t>(id)} : KeyframeId{};
  };
  const auto block_of = [](int64_t id) { return static_cast<uint32_t>(id - 1); };
  take("found_cameras", &r.calibrated_cameras, [&](int64_t id, std::span<const uint8_t> data) {
    return is_item(id, kMaxCalibratedCameras)
               ? decode_calibrated_camera(static_cast<int>(id - 1), data, cameras)
               : std::nullopt;
  });
  take("keyframes", &r.keyframes, [&](int64_t id, std::span<const uint8_t> data) {
    return keyframe_id(id) ? decode_keyframe(keyframe_id(id), data, cameras) : std::nullopt;
  });
  std::map<std::pair<int, int>, GrayImagePtr> of_size;
  const auto read_image = [&](int64_t id, std::span<const uint8_t> data) -> std::optional<ImageRecord> {
    ImageRecord image{keyframe_id(id), keyframe_id(id) ? decode_image_row(data) : nullptr};
    if (image.image == nullptr) return std::nullopt;
    if (images == LoadedImages::kDecodedOnly)
      image.image =
          of_size.emplace(std::pair(image.image->width(), image.image->height()), image.image).first->second;
    return image;
  };
  if (images != LoadedImages::kNone) take("images", &r.images, read_image);
  take("measurements", &r.measurements, [&](int64_t id, std::span<const uint8_t> data) {
    return keyframe_id(id) ? decode_measurements(keyframe_id(id), data) : std::nullopt;
  });
  take("sources", &r.sources, [&](int64_t id, std::span<const uint8_t> data) {
    return is_item(id, kMaxBlocks) ? decode_sources(block_of(id), data) : std::nullopt;
  });
  take("positions", &r.positions, [&](int64_t id, std::span<const uint8_t> data) {
    return is_item(id, kMaxBlocks) ? decode_positions(block_of(id), data) : std::nullopt;
  });
  take("epochs", &map.epochs, decode_epoch);
  take("decisions", &map.decisions,
       [](int64_t, std::span<const uint8_t> data) { return decode_decision(data); });
  take("labels", &map.labels, decode_label);
  load_proposals(&map);
  load_contributions(&map);
  return map;
}

}  // namespace cairn
