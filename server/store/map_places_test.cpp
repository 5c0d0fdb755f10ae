// SPDX-License-Identifier: Apache-2.0
// The file of a map, its log and its place in the store's folder: whatever lies there, and whenever the
// server ended.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "server/store/store_fixture.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

using MapPlacesTest = testing::StoreFixture;

TEST_F(MapPlacesTest, ADamagedMapIsKeptAsideAndWhatIsLeftOfItGoesOn) {
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

TEST_F(MapPlacesTest, WhatAnEndLeftHalfDoneIsPutInOrder) {
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

TEST_F(MapPlacesTest, ALogFollowsItsFileFromWhichAnEndHasPartedIt) {
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

TEST_F(MapPlacesTest, ALogFollowsAFileThatWasBeingSetAside) {
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

TEST_F(MapPlacesTest, WhatLiesInAMapsPlaceIsNotOverwritten) {
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

TEST_F(MapPlacesTest, ASavedMapThatCannotTakeItsPlaceIsToldAndKept) {
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

TEST_F(MapPlacesTest, AMapsPlaceTakesWholeFilesOnly) {
  const auto store = open();
  keep(store.get());
  const std::string name = to_hex(header_.id.bytes) + ".cairnmap";
  EXPECT_THAT(files_in("maps"), ElementsAre(name)) << "in one file, from the first moment";
  ASSERT_TRUE(store->replace(header_, {whole(), {}, {}, {}}, {"a row"}));
  EXPECT_THAT(files_in("maps"), ElementsAre(name));
  EXPECT_TRUE(store->load(header_.id));
}

TEST_F(MapPlacesTest, AFileThatWasCutIsDamagedWhateverIsLeftOfIt) {
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

}  // namespace
}  // namespace cairn
