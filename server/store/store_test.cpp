// SPDX-License-Identifier: Apache-2.0
#include "server/store/store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "server/store/entry_codec.h"
#include "server/store/kept_map_fixture.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class StoreTest : public testing::KeptMapFixture {
 protected:
  [[nodiscard]] std::unique_ptr<Store> open() const {
    auto store = Store::open(folder_, null_logger());
    EXPECT_TRUE(store) << store.error().message;
    return store ? std::move(*store) : nullptr;
  }
  void keep(Store* store) {
    start();
    const Status made = store->create(header_, take_update());
    ASSERT_TRUE(made) << made.error().message;
  }
  /// A map whose last change, its name "bench", is in its log alone, as a kill leaves both: copied to `file`
  /// and `file`-wal.
  void keep_apart(const std::filesystem::path& file) {
    const auto store = open();
    keep(store.get());
    ASSERT_TRUE(store->rename(header_.id, "bench"));
    for (const char* end : {"", "-wal"})
      std::filesystem::copy_file(store->path_of(header_.id).string() + end, file.string() + end);
    ASSERT_GT(std::filesystem::file_size(file.string() + "-wal"), 0U);
  }
  [[nodiscard]] static std::string name_in(const std::filesystem::path& file) {
    const auto opened = MapFile::open(file);
    return opened ? opened->header().name : opened.error().message;
  }
  [[nodiscard]] std::vector<std::string> files_in(const char* part) const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / part))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }
};

TEST_F(StoreTest, IsTheSameServerAndLaterAtEveryStart) {
  uint64_t last = 0;
  ServerId server;
  for (int i = 0; i < 3; ++i) {
    const auto store = open();
    EXPECT_GT(store->start_count(), last);
    last = store->start_count();
    EXPECT_TRUE(store->server());
    EXPECT_TRUE(i == 0 || store->server() == server);
    server = store->server();
  }
}

TEST_F(StoreTest, BelongsToOneServerAtATime) {
  const auto first = open();
  const auto second = Store::open(folder_, null_logger());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kRefused);
  EXPECT_THAT(second.error().message, HasSubstr(folder_.string()));
}

TEST_F(StoreTest, MapsComeBackUnderLaterEpochs) {
  std::vector<uint8_t> kept;
  {
    const auto store = open();
    keep(store.get());
    ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
    const MapUpdate update = take_update();
    ASSERT_TRUE(store->write(header_.id, {&update, 1}));
    EXPECT_EQ(store->create(header_, {}).error().code, ErrorCode::kRefused);
  }
  Epoch last = header_.epoch;
  for (int i = 0; i < 3; ++i) {
    const auto store = open();
    EXPECT_THAT(store->maps(), ElementsAre(header_.id));
    const auto map = store->load(header_.id);
    ASSERT_TRUE(map) << map.error().message;
    EXPECT_GT(map->header.epoch, last);
    last = map->header.epoch;
    EXPECT_EQ(map->epochs.size(), static_cast<size_t>(i) + 2);
    EXPECT_TRUE(bytes_of(map->record) == bytes_of(whole()));
  }
}

TEST_F(StoreTest, DeletedMapsCanBeHadBack) {
  const auto store = open();
  keep(store.get());
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->remove(header_.id)) << "idempotent";
  EXPECT_THAT(store->maps(), IsEmpty());
  ASSERT_EQ(store->deleted_maps().size(), 1U);
  EXPECT_EQ(store->deleted_maps()[0].header.name, "desk");
  EXPECT_THAT(store->deleted_ids(), ElementsAre(header_.id));
  EXPECT_EQ(store->create(header_, {}).error().code, ErrorCode::kRefused) << "its id is not given again";
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->undelete(header_.id));
  EXPECT_THAT(store->maps(), ElementsAre(header_.id));
  EXPECT_TRUE(store->load(header_.id));
  EXPECT_EQ(store->remove(MapId{{9}}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(store->undelete(MapId{{9}}).error().code, ErrorCode::kNotFound);
  ASSERT_TRUE(store->remove(header_.id));
  for (int times = 0; times < 2; ++times) EXPECT_TRUE(store->purge(header_.id));
  EXPECT_THAT(store->deleted_ids(), IsEmpty());
}

TEST_F(StoreTest, TheMapDeletedLastIsNamedFirst) {
  const auto store = open();
  start();
  const MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3}) {
    header_.id = MapId{{id}};
    ASSERT_TRUE(store->create(header_, whole));
  }
  for (const uint8_t id : {2, 3, 1}) ASSERT_TRUE(store->remove(MapId{{id}}));
  const auto deleted = store->deleted_maps();
  ASSERT_EQ(deleted.size(), 3U);
  EXPECT_EQ(deleted[0].header.id, MapId{{1}});
  EXPECT_EQ(deleted[2].header.id, MapId{{2}});
  EXPECT_GT(deleted[0].bytes, 0U);
}

TEST_F(StoreTest, OfDeletedMapsTheFirstAndTheLastDecisionsAreTold) {
  const auto store = open();
  start();
  MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3}) {
    header_.id = MapId{{id}};
    whole.decisions.clear();
    for (uint64_t seq = 1; seq <= 4 * id; ++seq) whole.decisions.push_back(decision(100 * id + seq));
    ASSERT_TRUE(store->create(header_, whole));
  }
  for (const uint8_t id : {2, 3, 1}) ASSERT_TRUE(store->remove(MapId{{id}}));
  const auto told = store->decisions_on_deleted(2, 3);
  ASSERT_THAT(told, SizeIs(2));
  const auto numbers = [](const DeletedDecisions& map) {
    std::vector<uint64_t> all;
    for (const DecisionRecord& d : map.decisions) all.push_back(d.seq);
    return all;
  };
  EXPECT_EQ(told[0].header.id, MapId{{1}}) << "deleted last";
  EXPECT_THAT(numbers(told[0]), ElementsAre(101, 102, 103, 104)) << "all that there are";
  EXPECT_EQ(told[1].header.id, MapId{{3}});
  EXPECT_THAT(numbers(told[1]), ElementsAre(301, 310, 311, 312));
}

TEST_F(StoreTest, ADeletedMapWithADamagedFileIsListedAndCanBePurged) {
  const auto store = open();
  start();
  const MapUpdate whole = take_update();
  for (const uint8_t id : {1, 2, 3, 4}) {
    header_.id = MapId{{id}};
    ASSERT_TRUE(store->create(header_, whole));
    ASSERT_TRUE(store->remove(header_.id));
  }
  const auto file = [this](uint8_t id) {
    return folder_ / "deleted" / (to_hex(MapId{{id}}.bytes) + ".cairnmap");
  };
  ASSERT_TRUE(sqlite::Database::open(file(1), sqlite::OpenMode::kReadWrite)
                  ->execute("UPDATE map SET checksum = checksum + 1 WHERE id = 1"));
  std::filesystem::resize_file(file(2), 0);
  std::filesystem::copy_file(file(4), file(3), std::filesystem::copy_options::overwrite_existing);
  const auto deleted = store->deleted_maps();
  ASSERT_THAT(deleted, SizeIs(4));
  std::set<MapId> ids;
  for (const DeletedMap& map : deleted) {
    ids.insert(map.header.id);
    if (map.header.id == MapId{{4}}) {
      EXPECT_FALSE(map.problem);
      continue;
    }
    ASSERT_TRUE(map.problem);
    EXPECT_EQ(map.problem->code, ErrorCode::kDamaged);
    EXPECT_THAT(map.problem->message, HasSubstr(to_hex(map.header.id.bytes)));
    EXPECT_TRUE(store->purge(map.header.id));
  }
  EXPECT_THAT(ids, SizeIs(4)) << "each under its own id";
  EXPECT_THAT(store->deleted_ids(), ElementsAre(MapId{{4}}));
}

TEST_F(StoreTest, AnArchiveWithAViewInPlaceOfATableIsRefused) {
  const auto store = open();
  keep(store.get());
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store->export_map(header_.id, archive));
  ASSERT_TRUE(store->remove(header_.id));
  ASSERT_TRUE(store->purge(header_.id));
  const char* tamperings[] = {
      "ALTER TABLE keyframes RENAME TO k; CREATE VIEW keyframes AS WITH RECURSIVE r(id) AS (SELECT 1 UNION "
      "ALL "
      "SELECT id + 1 FROM r) SELECT id, x'00' AS data, 0 AS checksum FROM r",
      "CREATE TRIGGER t AFTER INSERT ON epochs BEGIN DELETE FROM keyframes; END",
      "DROP TABLE labels",
  };
  for (const char* tampering : tamperings) {
    SCOPED_TRACE(tampering);
    const std::filesystem::path bad = folder_ / "bad.cairnmap";
    std::filesystem::copy_file(archive, bad, std::filesystem::copy_options::overwrite_existing);
    {
      auto database = sqlite::Database::open(bad, sqlite::OpenMode::kReadWrite);
      ASSERT_TRUE(database);
      const Status done = database->execute(tampering);
      ASSERT_TRUE(done) << done.error().message;
    }
    const auto imported = store->import_map(bad);
    ASSERT_FALSE(imported);
    EXPECT_EQ(imported.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(imported.error().message,
                ::testing::AnyOf(HasSubstr("no such file has"), HasSubstr("missing")));
  }
  EXPECT_TRUE(store->import_map(archive));
}

TEST_F(StoreTest, ADamagedMapIsKeptAsideAndWhatIsLeftOfItGoesOn) {
  const auto store = open();
  keep(store.get());
  const auto aside = store->replace(header_, {whole(), {}, {}, {}}, {"row 3 of images is damaged"});
  ASSERT_TRUE(aside) << aside.error().message;
  EXPECT_TRUE(MapFile::open(*aside));
  EXPECT_THAT(store->maps(), ElementsAre(header_.id));
  EXPECT_TRUE(store->load(header_.id));
  std::ifstream reasons(aside->string() + ".txt");
  const std::string said(std::istreambuf_iterator<char>(reasons), {});
  EXPECT_THAT(said, HasSubstr("row 3 of images is damaged\n"));
  ASSERT_TRUE(store->set_aside(header_.id, "", {"no map", "at all"}));
  EXPECT_THAT(store->maps(), IsEmpty());

  std::ofstream(folder_ / "damaged/notes.md") << "an operator's";
  const std::vector<DamagedFile> damaged = store->damaged_files();
  ASSERT_EQ(damaged.size(), 2U);
  for (const DamagedFile& file : damaged) {
    EXPECT_EQ(file.map, header_.id);
    EXPECT_EQ(file.bytes, std::filesystem::file_size(file.path));
    EXPECT_GT(file.set_aside.nanoseconds, 0);
  }
  const bool in_order = damaged[0].path == *aside;
  const DamagedFile& replaced = damaged[in_order ? 0 : 1];
  const DamagedFile& lost = damaged[in_order ? 1 : 0];
  EXPECT_EQ(replaced.name, header_.name);
  EXPECT_THAT(replaced.reasons, ElementsAre("row 3 of images is damaged"));
  EXPECT_EQ(lost.name, "");
  EXPECT_THAT(lost.reasons, ElementsAre("no map", "at all"));
  std::filesystem::remove(replaced.path);
  EXPECT_EQ(store->damaged_files().size(), 1U);
}

TEST_F(StoreTest, ADamagedCatalogueIsSetAsideAndTheMapsStay) {
  ServerId server;
  {
    const auto store = open();
    keep(store.get());
    server = store->server();
  }
  std::ofstream(folder_ / "catalogue.db") << "this is not a database, whatever its name says";
  const auto store = open();
  ASSERT_NE(store, nullptr);
  EXPECT_NE(store->server(), server);
  EXPECT_TRUE(store->load(header_.id));
  const std::vector<DamagedFile> damaged = store->damaged_files();
  ASSERT_EQ(damaged.size(), 1U);
  EXPECT_THAT(damaged[0].path.filename(), ::testing::StartsWith("catalogue-"));
  EXPECT_FALSE(damaged[0].map);
  EXPECT_THAT(damaged[0].reasons, ElementsAre(HasSubstr("not a database")));
}

TEST_F(StoreTest, ACatalogueThatIsCutOffIsBegunAnewAndNotSilently) {
  const auto say_at_open = [&] {
    std::ostringstream said;
    const auto store = Store::open(
        folder_,
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said)));
    EXPECT_TRUE(store);
    return said.str();
  };
  EXPECT_EQ(say_at_open(), "") << "a new store";
  keep(open().get());
  EXPECT_EQ(say_at_open(), "");
  std::filesystem::resize_file(folder_ / "catalogue.db", 0);
  EXPECT_THAT(say_at_open(), HasSubstr("catalogue.db: empty, though there are maps"));
  std::filesystem::remove(folder_ / "catalogue.db");
  EXPECT_THAT(say_at_open(), HasSubstr("catalogue.db: not there, though there are maps"));
  EXPECT_TRUE(open()->load(header_.id));
}

const std::vector<OverlapRecord> kOverlaps = {
    {MapId{{1}}, MapId{{2}}, 3, 0, Timestamp{5}},
    {MapId{{1}}, MapId{{3}}, 1, 7, Timestamp{-6}},
};

TEST_F(StoreTest, OverlapsAreKeptThroughStarts) {
  {
    const auto store = open();
    EXPECT_THAT(store->overlaps(), IsEmpty());
    ASSERT_TRUE(store->keep_overlaps(std::vector{kOverlaps[1]}));
    const Status kept = store->keep_overlaps(kOverlaps);
    ASSERT_TRUE(kept) << kept.error().message;
  }
  for (int i = 0; i < 2; ++i) EXPECT_EQ(open()->overlaps(), kOverlaps);
  ASSERT_TRUE(open()->keep_overlaps({}));
  EXPECT_THAT(open()->overlaps(), IsEmpty());
}

TEST_F(StoreTest, ADamagedOverlapCostsNoOtherAndNothingElse) {
  const ServerId server = open()->server();
  ASSERT_TRUE(open()->keep_overlaps(kOverlaps));
  {
    auto catalogue = sqlite::Database::open(folder_ / "catalogue.db", sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(catalogue->execute("UPDATE overlaps SET checksum = checksum + 1 WHERE id = 1"));
  }
  const auto store = open();
  EXPECT_THAT(store->overlaps(), ElementsAre(kOverlaps[1]));
  EXPECT_EQ(store->server(), server);
  EXPECT_THAT(files_in("damaged"), IsEmpty());
}

TEST_F(StoreTest, ACatalogueOfTheFirstSchemaIsBroughtUpToDate) {
  const ServerId server = open()->server();
  {
    auto catalogue = sqlite::Database::open(folder_ / "catalogue.db", sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(catalogue->execute("DROP TABLE overlaps; PRAGMA user_version=1"));
  }
  EXPECT_EQ(open()->server(), server);
  ASSERT_TRUE(open()->keep_overlaps(kOverlaps));
  EXPECT_EQ(open()->overlaps(), kOverlaps);
}

TEST(OverlapRow, IsReadAsItWasWrittenOrNotAtAll) {
  const Blob row = encode_overlap(kOverlaps[1]);
  EXPECT_EQ(decode_overlap(row), kOverlaps[1]);
  for (size_t size = 0; size < row.size(); ++size)
    EXPECT_FALSE(decode_overlap(Blob(row.begin(), row.begin() + static_cast<ptrdiff_t>(size))));
  Blob longer = row;
  longer.push_back(0);
  EXPECT_FALSE(decode_overlap(longer));
  OverlapRecord wrong = kOverlaps[0];
  std::swap(wrong.one, wrong.other);
  EXPECT_FALSE(decode_overlap(encode_overlap(wrong))) << "nobody writes it so";
  EXPECT_FALSE(decode_overlap(encode_overlap({MapId{{1}}, MapId{{1}}, 3, 0, {}}))) << "with itself";
  EXPECT_FALSE(decode_overlap(encode_overlap({MapId(), MapId{{1}}, 3, 0, {}})));
  EXPECT_FALSE(decode_overlap(encode_overlap({MapId{{1}}, MapId{{2}}, 1U << 31, 0, {}})));
}

TEST_F(StoreTest, WhatAnEndLeftHalfDoneIsPutInOrder) {
  {
    const auto store = open();
    keep(store.get());
  }
  const std::filesystem::path maps = folder_ / "maps";
  const std::string name = to_hex(header_.id.bytes);
  const std::string half = to_hex(MapId{{8}}.bytes);
  const std::string moved = to_hex(MapId{{9}}.bytes);
  // Ended while a map was being made: nobody has been told of it.
  for (const char* end : {"", "-wal", "-shm", "-journal"})
    std::ofstream(maps / (half + ".new" + end)) << "half";
  // Ended between setting a damaged map aside, but for its log, and putting the saved one in its place.
  std::filesystem::rename(maps / (name + ".cairnmap"), maps / (name + ".saved"));
  std::ofstream(maps / (name + ".cairnmap-wal")) << "of another file";
  // Ended while a deleted map was put back.
  std::ofstream(folder_ / "deleted" / (moved + ".cairnmap-wal")) << "of a file that has gone";
  const auto store = open();
  EXPECT_TRUE(store->load(header_.id)) << "the saved one is in place";
  EXPECT_THAT(store->maps(), ElementsAre(header_.id));
  EXPECT_THAT(files_in("maps"), ElementsAre(name + ".cairnmap"));
  EXPECT_THAT(files_in("deleted"), IsEmpty());
  const std::vector<DamagedFile> logs = store->damaged_files();
  ASSERT_THAT(logs, SizeIs(2)) << "kept, away from files that they do not belong to";
  EXPECT_EQ(logs[0].map, header_.id);
  EXPECT_EQ(logs[1].map, (MapId{{9}}));
  for (const DamagedFile& log : logs) {
    EXPECT_THAT(log.reasons, ElementsAre(HasSubstr("log without its file")));
    EXPECT_GT(log.set_aside.nanoseconds, 0);
    EXPECT_EQ(log.bytes, std::filesystem::file_size(log.path));
  }
}

TEST_F(StoreTest, ALogFollowsItsFileFromWhichAnEndHasPartedIt) {
  const std::filesystem::path sound = folder_ / "sound";
  keep_apart(sound);
  const std::string name = to_hex(header_.id.bytes) + ".cairnmap";
  for (const auto& [file_in, log_in] : {std::pair("deleted", "maps"), std::pair("maps", "deleted")}) {
    for (const bool has_empty_log : {false, true}) {
      SCOPED_TRACE(::testing::Message() << "file in " << file_in << (has_empty_log ? " with a new log" : ""));
      const TestDirectory other;
      const std::filesystem::path file = other.path() / file_in / name;
      for (const char* part : {file_in, log_in}) std::filesystem::create_directory(other.path() / part);
      std::filesystem::copy_file(sound, file);
      std::filesystem::copy_file(sound.string() + "-wal", other.path() / log_in / (name + "-wal"));
      if (has_empty_log) std::ofstream(file.string() + "-wal");
      const auto store = Store::open(other.path(), null_logger());
      ASSERT_TRUE(store);
      EXPECT_EQ(name_in(file), "bench");
      EXPECT_THAT((*store)->damaged_files(), IsEmpty());
      EXPECT_FALSE(std::filesystem::exists(other.path() / log_in / (name + "-wal")));
    }
  }
}

TEST_F(StoreTest, ALogFollowsAFileThatWasBeingSetAside) {
  const std::filesystem::path sound = folder_ / "sound";
  keep_apart(sound);
  const std::string name = to_hex(header_.id.bytes);
  const TestDirectory other;
  for (const char* part : {"maps", "damaged"}) std::filesystem::create_directory(other.path() / part);
  const std::filesystem::path aside = other.path() / "damaged" / (name + "-20260101T000000Z.cairnmap");
  const std::filesystem::path earlier = other.path() / "damaged" / (name + "-20250101T000000Z.cairnmap");
  const std::filesystem::path log = other.path() / "maps" / (name + ".cairnmap-wal");
  for (const auto& file : {aside, earlier}) std::filesystem::copy_file(sound, file);
  std::ofstream(earlier.string() + ".txt") << "was whole, and all of it moved";
  std::filesystem::copy_file(sound.string() + "-wal", log);
  {
    const auto store = Store::open(other.path(), null_logger());
    ASSERT_TRUE(store);
    EXPECT_FALSE(std::filesystem::exists(log));
    const std::vector<DamagedFile> damaged = (*store)->damaged_files();
    ASSERT_THAT(damaged, SizeIs(2));
    EXPECT_EQ(damaged[1].path, aside);
    EXPECT_THAT(damaged[1].reasons, SizeIs(1));
  }
  EXPECT_EQ(name_in(aside), "bench");
  EXPECT_EQ(name_in(earlier), "desk");

  // Of two, nobody knows which.
  for (const auto& file : {aside, earlier}) std::filesystem::remove(file.string() + ".txt");
  std::filesystem::copy_file(sound.string() + "-wal", log);
  const auto store = Store::open(other.path(), null_logger());
  EXPECT_THAT((*store)->damaged_files(), SizeIs(3));
  EXPECT_EQ(name_in(earlier), "desk");
}

TEST_F(StoreTest, AnImportedMapTakesNoLogThatLiesInItsPlace) {
  const std::filesystem::path sound = folder_ / "sound";
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  keep_apart(sound);
  const auto store = open();
  ASSERT_TRUE(store->rename(header_.id, "attic"));
  ASSERT_TRUE(store->export_map(header_.id, archive));
  ASSERT_TRUE(store->remove(header_.id));
  ASSERT_TRUE(store->purge(header_.id));
  // An operator has taken the file away, and left its log.
  std::filesystem::copy_file(sound.string() + "-wal", store->path_of(header_.id).string() + "-wal");
  const auto imported = store->import_map(archive);
  ASSERT_TRUE(imported) << imported.error().message;
  const auto map = store->load(header_.id);
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->header.name, "attic");
  EXPECT_THAT(map->damage, IsEmpty());
  EXPECT_THAT(store->damaged_files(), SizeIs(1));
}

TEST_F(StoreTest, AnArchiveIsJudgedByWhatItsImagesTakeAsDecoded) {
  const auto store = open();
  keep(store.get());
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store->export_map(header_.id, archive));
  ASSERT_TRUE(store->remove(header_.id));
  ASSERT_TRUE(store->purge(header_.id));
  const auto read = read_archive(archive);
  ASSERT_TRUE(read);
  const std::vector<uint8_t> before = bytes_of(read->record);
  uint64_t pixels = 0;
  for (const ImageRecord& r : read->record.images)
    pixels += static_cast<uint64_t>(r.image->width()) * static_cast<uint64_t>(r.image->height());
  const auto refused = store->import_map(archive, pixels - 1);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
  EXPECT_THAT(refused.error().message, HasSubstr("its images take"));
  EXPECT_THAT(refused.error().message, HasSubstr("(--max-memory)"));
  EXPECT_THAT(files_in("maps"), IsEmpty());
  const auto imported = store->import_map(archive, pixels);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_TRUE(bytes_of(store->load(*imported)->record) == before);
}

TEST_F(StoreTest, WhatLiesInAMapsPlaceIsNotOverwritten) {
  const auto store = open();
  keep(store.get());
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store->export_map(header_.id, archive));
  ASSERT_TRUE(store->remove(header_.id));
  // On a disk that is not mounted now.
  const std::filesystem::path place = store->path_of(header_.id);
  std::filesystem::create_symlink(folder_ / "elsewhere" / "map", place);
  EXPECT_EQ(store->undelete(header_.id).error().code, ErrorCode::kRefused);
  ASSERT_TRUE(store->purge(header_.id));
  EXPECT_EQ(store->import_map(archive).error().code, ErrorCode::kRefused);
  EXPECT_EQ(store->create(header_, {whole(), {}, {}, {}}).error().code, ErrorCode::kRefused);
  EXPECT_TRUE(std::filesystem::is_symlink(place));
  EXPECT_THAT(files_in("maps"), ElementsAre(place.filename().string()));
}

TEST_F(StoreTest, ASavedMapThatCannotTakeItsPlaceIsToldAndKept) {
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  std::filesystem::path place;
  {
    const auto store = open();
    keep(store.get());
    ASSERT_TRUE(store->export_map(header_.id, archive));
    place = store->path_of(header_.id);
  }
  const std::filesystem::path saved = std::filesystem::path(place).replace_extension(".saved");
  std::filesystem::rename(place, saved);
  std::filesystem::create_symlink(folder_ / "elsewhere" / "map", place);
  {
    const auto store = open();
    ASSERT_THAT(store->unplaced(), SizeIs(1));
    EXPECT_EQ(store->unplaced()[0].map, header_.id);
    EXPECT_EQ(store->unplaced()[0].file, saved);
    EXPECT_THAT(store->unplaced()[0].reason, HasSubstr(place.string()));
    std::filesystem::remove(place);
    for (const Status& refused : {store->create(header_, {whole(), {}, {}, {}}),
                                  Status(store->import_map(archive).map([](MapId) {}))}) {
      ASSERT_FALSE(refused) << "the next start would drop what was saved";
      EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
      EXPECT_THAT(refused.error().message, HasSubstr(saved.string()));
    }
  }
  const auto store = open();
  EXPECT_THAT(store->unplaced(), IsEmpty());
  EXPECT_TRUE(store->load(header_.id));
}

TEST_F(StoreTest, AMapsPlaceTakesWholeFilesOnly) {
  const auto store = open();
  keep(store.get());
  const std::string name = to_hex(header_.id.bytes) + ".cairnmap";
  EXPECT_THAT(files_in("maps"), ElementsAre(name)) << "in one file, from the first moment";
  ASSERT_TRUE(store->replace(header_, {whole(), {}, {}, {}}, {"a row"}));
  EXPECT_THAT(files_in("maps"), ElementsAre(name));
  EXPECT_TRUE(store->load(header_.id));
}

TEST_F(StoreTest, AFileThatWasCutIsDamagedWhateverIsLeftOfIt) {
  const auto store = open();
  keep(store.get());
  const std::filesystem::path file = folder_ / "maps" / (to_hex(header_.id.bytes) + ".cairnmap");
  const std::filesystem::path log(file.string() + "-wal");
  const std::filesystem::path sound = folder_ / "sound";
  const std::filesystem::path sound_log = folder_ / "sound-log";
  ASSERT_TRUE(store->rename(header_.id, "bench"));  // by a connection that stays open: its log is there
  std::filesystem::copy_file(file, sound);
  std::filesystem::copy_file(log, sound_log);
  ASSERT_GT(std::filesystem::file_size(sound_log), 0U);
  const uintmax_t size = std::filesystem::file_size(sound);
  for (const uintmax_t left : {uintmax_t{0}, uintmax_t{1}, uintmax_t{100}, uintmax_t{4096}, size / 2}) {
    for (const bool with_log : {false, true}) {
      SCOPED_TRACE(::testing::Message() << left << " bytes" << (with_log ? " and a log" : ""));
      const TestDirectory other_folder;
      const auto other = Store::open(other_folder.path(), null_logger());
      ASSERT_TRUE(other);
      const std::filesystem::path cut = other_folder.path() / "maps" / file.filename();
      std::filesystem::copy_file(sound, cut);
      std::filesystem::resize_file(cut, left);
      if (with_log) std::filesystem::copy_file(sound_log, cut.string() + "-wal");
      const auto loaded = (*other)->load(header_.id);
      if (loaded) {
        EXPECT_FALSE(loaded->damage.empty());
      } else {
        EXPECT_EQ(loaded.error().code, ErrorCode::kDamaged) << loaded.error().message;
      }
      EXPECT_TRUE(std::filesystem::exists(cut)) << "to be set aside";
      EXPECT_THAT((*other)->maps(), ElementsAre(header_.id));
      if (left == 0) {
        EXPECT_EQ(std::filesystem::file_size(cut), 0U) << "as it was found";
        EXPECT_EQ(std::filesystem::exists(cut.string() + "-wal"), with_log);
      }
    }
  }
}

TEST_F(StoreTest, AnArchiveImportsIntoAnotherStore) {
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  {
    const auto store = open();
    keep(store.get());
    MapUpdate said;
    said.decisions = {decision(1)};
    said.labels = {{1, "vice", SE3(), "anna", Timestamp{5}}};
    ASSERT_TRUE(store->write(header_.id, {&said, 1}));
    const Status exported = store->export_map(header_.id, archive);
    ASSERT_TRUE(exported) << exported.error().message;
    const auto again = store->import_map(archive);
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().code, ErrorCode::kRefused);
    const std::string name = to_hex(header_.id.bytes) + ".cairnmap";
    EXPECT_THAT(again.error().message, HasSubstr((folder_ / "maps" / name).string()));
    ASSERT_TRUE(store->remove(header_.id));
    EXPECT_THAT(store->import_map(archive).error().message, HasSubstr((folder_ / "deleted" / name).string()));
  }
  const auto other = Store::open(folder_ / "other", null_logger());
  ASSERT_TRUE(other);
  const auto imported = (*other)->import_map(archive);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(*imported, header_.id);
  const auto map = (*other)->load(header_.id);
  ASSERT_TRUE(map);
  EXPECT_EQ(map->header.name, "desk");
  EXPECT_TRUE(bytes_of(map->record) == bytes_of(whole()));
  EXPECT_THAT(map->labels, SizeIs(1));
  EXPECT_THAT(map->decisions, IsEmpty()) << "clients of these names here are others";

  std::filesystem::resize_file(archive, std::filesystem::file_size(archive) / 2);
  const auto third = Store::open(folder_ / "third", null_logger());
  EXPECT_EQ((*third)->import_map(archive).error().code, ErrorCode::kDamaged);
  EXPECT_THAT((*third)->maps(), IsEmpty());
}

}  // namespace
}  // namespace cairn
