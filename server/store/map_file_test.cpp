// SPDX-License-Identifier: Apache-2.0
#include "server/store/map_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <limits>
#include <random>

#include "server/mapping/map_maker.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/schema.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr size_t kAllBytes = std::numeric_limits<size_t>::max();

class MapFileTest : public testing::KeptMapFixture {
 protected:
  MapFileTest() : path_(folder_ / "map.cairnmap") {}

  /// A map of three keyframes, written as it grew.
  void keep() {
    start();
    MapUpdate first = take_update();
    first.decisions = {decision(1)};
    auto file = MapFile::create(path_, header_, first);
    ASSERT_TRUE(file) << file.error().message;
    ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
    MapUpdate second = take_update();
    second.decisions = {decision(2), decision(3)};
    second.labels = {{1, "vice", SE3(), "anna", Timestamp{5}}, {2, "gone", SE3(), "anna", Timestamp{6}}};
    MapUpdate third;
    third.removed_labels = {2};
    adjust_globally();
    third.record = maker_->take_changes();
    const Status written = file->write(std::vector{second, third});
    ASSERT_TRUE(written) << written.error().message;
  }
  [[nodiscard]] StoredMap load() const {
    auto file = MapFile::open(path_);
    EXPECT_TRUE(file) << file.error().message;
    return file ? file->load() : StoredMap();
  }
  [[nodiscard]] sqlite::Database open_raw() const {
    return *sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
  }

  std::filesystem::path path_;
};

TEST_F(MapFileTest, WhatIsReadIsWhatWasWritten) {
  keep();
  const StoredMap stored = load();
  EXPECT_THAT(stored.damage, IsEmpty());
  EXPECT_EQ(stored.header.id, header_.id);
  EXPECT_EQ(stored.header.name, "desk");
  EXPECT_EQ(stored.header.epoch, Epoch{3});
  EXPECT_TRUE(bytes_of(stored.record) == bytes_of(whole()));
  ASSERT_EQ(stored.decisions.size(), 3U);
  EXPECT_EQ(stored.decisions[2].seq, 3U);
  EXPECT_EQ(stored.decisions[2].client, "anna");
  EXPECT_EQ(stored.decisions[2].session, SessionId{42});
  EXPECT_EQ(stored.decisions[2].reason, "because");
  ASSERT_EQ(stored.labels.size(), 1U);
  EXPECT_EQ(stored.labels[0].text, "vice");
  const auto restored =
      MapMaker::restore(stored.record, {stored.header.id, stored.header.name, Epoch{4}}, options_);
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_THAT(restored->repairs, IsEmpty());
  EXPECT_EQ(restored->maker->statistics().measurements, maker_->statistics().measurements);
}

TEST_F(MapFileTest, WhoMadeTheMapIsKnownHoweverMuchWasDecidedSince) {
  start();
  MapUpdate first = take_update();
  first.decisions = {decision(1)};
  first.decisions[0].kind = CommandKind::kSeed;
  auto file = MapFile::create(path_, header_, first);
  ASSERT_TRUE(file) << file.error().message;
  MapUpdate more;
  for (uint64_t seq = 2; seq < 10'100; ++seq) more.decisions.push_back(decision(seq));
  ASSERT_TRUE(file->write({&more, 1}));
  const StoredMap stored = file->load();
  EXPECT_THAT(stored.decisions, SizeIs(10'001));
  EXPECT_EQ(stored.decisions[0].kind, CommandKind::kSeed);
  EXPECT_EQ(stored.decisions[1].seq, 100U);
}

TEST_F(MapFileTest, ImagesAreReadOneByOneAsTheyWereWritten) {
  keep();
  auto file = MapFile::open(path_);
  ASSERT_TRUE(file);
  const std::vector<KeyframeId> wanted{KeyframeId{3}, KeyframeId{1}};
  const auto rows = file->read_images(wanted, kAllBytes);
  ASSERT_TRUE(rows) << rows.error().message;
  ASSERT_EQ(rows->size(), 2U);
  const MapRecord record = whole();
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ((*rows)[i].keyframe, wanted[i]);
    EXPECT_TRUE((*rows)[i].data == encode_image_row(*record.images[wanted[i].value - 1].image));
  }
  ASSERT_TRUE(open_raw().execute("UPDATE images SET id = 7 WHERE id = 3"));
  for (const uint64_t id : {3, 7}) {
    const auto refused = file->read_images(std::vector{KeyframeId{1}, KeyframeId{id}}, kAllBytes);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(refused.error().message, HasSubstr("table images, row " + std::to_string(id)));
  }
  EXPECT_TRUE(file->read_images(std::vector{KeyframeId{2}}, kAllBytes)) << "it goes on";
}

TEST_F(MapFileTest, ImagesAreReadUntilThereAreEnough) {
  keep();
  auto file = MapFile::open(path_);
  ASSERT_TRUE(file);
  const std::vector<KeyframeId> wanted{KeyframeId{1}, KeyframeId{2}, KeyframeId{3}};
  const auto sizes = file->read_images(wanted, kAllBytes);
  ASSERT_TRUE(sizes && sizes->size() == 3U);
  const size_t first = (*sizes)[0].data.size();
  const size_t second = (*sizes)[1].data.size();
  const auto count = [&](size_t enough) { return file->read_images(wanted, enough)->size(); };
  EXPECT_EQ(count(0), 1U) << "or nothing would ever come of it";
  EXPECT_EQ(count(first), 1U);
  EXPECT_EQ(count(first + 1), 2U);
  EXPECT_EQ(count(first + second), 2U);
  EXPECT_EQ(count(first + second + 1), 3U);
}

TEST_F(MapFileTest, ASelfCalibratedCameraIsKeptAndDoesNotFillTheFile) {
  use_prior(1.04);
  keep();
  {
    auto file = MapFile::open(path_);
    ASSERT_TRUE(file);
    ASSERT_EQ(offer(8).verdict, KeyframeVerdict::kAccepted);
    adjust_globally();
    ASSERT_TRUE(file->write(std::vector{take_update()}));
  }
  StoredMap stored = load();
  EXPECT_THAT(stored.damage, IsEmpty());
  ASSERT_EQ(stored.record.calibrated_cameras.size(), 1U);
  const MapRecord all = whole();
  EXPECT_TRUE(bytes_of(stored.record) == bytes_of(all));
  sqlite::Database database = open_raw();
  EXPECT_EQ(*database.number("SELECT count(*) FROM cameras"), 1) << "its values are written anew in place";
}

TEST_F(MapFileTest, ANewEpochSaysWhatTheOldOneHadGivenOut) {
  keep();
  {
    auto file = MapFile::open(path_);
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->begin_epoch(Epoch{9}));
    ASSERT_TRUE(file->rename("bench"));
  }
  const StoredMap stored = load();
  EXPECT_EQ(stored.header.epoch, Epoch{9});
  EXPECT_EQ(stored.header.name, "bench");
  ASSERT_EQ(stored.epochs.size(), 2U);
  EXPECT_EQ(stored.epochs[0].epoch, Epoch{3});
  EXPECT_EQ(stored.epochs[1].epoch, Epoch{9});
  EXPECT_EQ(stored.epochs[1].keyframes, 3U);
  EXPECT_EQ(stored.epochs[1].points, stored.record.point_count);
}

/// As it was when its header was read, though another keyframe comes before the rest is.
TEST_F(MapFileTest, WhatIsReadBesideItsWriterIsAsOfOneMoment) {
  keep();
  const std::vector<uint8_t> before = bytes_of(load().record);
  auto writer = MapFile::open(path_);
  auto reader = MapFile::open(path_, FileOrigin::kOwn, FileInUse::kYes);
  ASSERT_TRUE(writer && reader);
  const size_t keyframes = load().record.keyframe_count;
  const auto grow = [&](int step) {
    ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    const MapUpdate update = take_update();
    ASSERT_TRUE(writer->write({&update, 1}));
  };
  grow(11);
  {
    const auto as_of_now = reader->read_as_of_now();
    ASSERT_TRUE(as_of_now);
    grow(14);
    const StoredMap stored = reader->load();
    EXPECT_THAT(stored.damage, IsEmpty());
    EXPECT_EQ(stored.record.keyframe_count, keyframes + 1);
    EXPECT_EQ(stored.record.keyframes.size(), keyframes + 1);
  }
  const auto later = reader->read_as_of_now();
  ASSERT_TRUE(later);
  EXPECT_EQ(reader->load().record.keyframe_count, keyframes + 2);
}

TEST_F(MapFileTest, AFileOfAnOlderSchemaIsBroughtUpToDate) {
  keep();
  const std::vector<uint8_t> before = bytes_of(load().record);
  for (const auto& [as_written, labels] :
       {std::pair("PRAGMA user_version=3", 1),
        std::pair("DROP TABLE found_cameras; PRAGMA user_version=2", 1),
        std::pair("DROP TABLE labels; DROP TABLE found_cameras; PRAGMA user_version=1", 0)}) {
    ASSERT_TRUE(open_raw().execute(std::string("DROP TABLE tags; DROP TABLE kept; DROP TABLE proposals; "
                                               "DROP TABLE proposal_pictures; DROP TABLE contributors; ") +
                                   as_written));
    const StoredMap stored = load();
    EXPECT_THAT(stored.damage, IsEmpty());
    EXPECT_THAT(stored.labels, SizeIs(labels));
    EXPECT_TRUE(bytes_of(stored.record) == before);
    sqlite::Database database = open_raw();
    EXPECT_EQ(*database.number("PRAGMA user_version"), map_schema_version());
    EXPECT_EQ(*database.number("SELECT count(*) FROM labels"), labels);
    EXPECT_EQ(*database.number("SELECT count(*) FROM found_cameras"), 0);
  }
}

TEST_F(MapFileTest, AFileOfANewerVersionIsLeftAlone) {
  keep();
  {
    sqlite::Database database = open_raw();
    ASSERT_TRUE(database.execute("PRAGMA user_version=99"));
  }
  const auto file = MapFile::open(path_);
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(file.error().message, HasSubstr("newer version"));
}

TEST_F(MapFileTest, WhatIsNoMapFileIsSaidToBeNone) {
  EXPECT_EQ(MapFile::open(folder_ / "none").error().code, ErrorCode::kNotFound);
  std::ofstream(folder_ / "text") << std::string(5000, 'x');
  EXPECT_EQ(MapFile::open(folder_ / "text").error().code, ErrorCode::kDamaged);
  ASSERT_TRUE(sqlite::Database::open(folder_ / "other", sqlite::OpenMode::kCreate)
                  ->execute("CREATE TABLE t(x); PRAGMA user_version=1"));
  EXPECT_EQ(MapFile::open(folder_ / "other").error().code, ErrorCode::kDamaged);
  (void)sqlite::Database::open(folder_ / "empty", sqlite::OpenMode::kCreate);
  EXPECT_EQ(MapFile::open(folder_ / "empty").error().code, ErrorCode::kDamaged);
}

TEST_F(MapFileTest, ADamagedRowIsNamedAndTheRestIsRead) {
  keep();
  const StoredMap sound = load();
  for (const char* table : {"epochs", "cameras", "keyframes", "images", "measurements", "sources",
                            "positions", "decisions", "labels"}) {
    SCOPED_TRACE(table);
    const std::string name(table);
    std::filesystem::copy_file(path_, folder_ / "copy", std::filesystem::copy_options::overwrite_existing);
    {
      auto database = sqlite::Database::open(folder_ / "copy", sqlite::OpenMode::kReadWrite);
      // The last byte of one row.
      const Status damaged =
          database->execute("UPDATE " + name +
                            " SET data = CAST(substr(data, 1, length(data) - 1) || "
                            "CASE substr(data, -1) WHEN x'00' THEN x'01' ELSE x'00' END AS BLOB) "
                            "WHERE id = (SELECT max(id) FROM " +
                            name + ")");
      ASSERT_TRUE(damaged) << damaged.error().message;
    }
    auto file = MapFile::open(folder_ / "copy");
    ASSERT_TRUE(file) << file.error().message;
    const StoredMap stored = file->load();
    ASSERT_FALSE(stored.damage.empty());
    EXPECT_THAT(stored.damage.front(), HasSubstr("table " + name + ", row"));
    EXPECT_THAT(stored.damage.front(), HasSubstr("checksum"));
    EXPECT_EQ(stored.record.sources.size(), sound.record.sources.size() - (name == "sources" ? 1 : 0));
  }
  // A row that stands where another should.
  {
    sqlite::Database database = open_raw();
    ASSERT_TRUE(database.execute("UPDATE measurements SET id = 77 WHERE id = 2"));
  }
  EXPECT_THAT(load().damage.front(), HasSubstr("table measurements, row 77: the checksum is wrong"));
}

TEST_F(MapFileTest, NoDamageToTheFileGoesUnnoticed) {
  constexpr unsigned kSeed = 99;
  keep();
  const std::vector<uint8_t> sound = bytes_of(load().record);
  std::string content;
  {
    std::ifstream in(path_, std::ios::binary);
    content.assign(std::istreambuf_iterator<char>(in), {});
  }
  std::mt19937 random(kSeed);
  for (int i = 0; i < 150; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", case " << i);
    std::string damaged = content;
    if (i % 10 == 0) {
      damaged.resize(random() % damaged.size());
    } else {
      for (int flips = 0; flips < 4; ++flips)
        damaged[random() % damaged.size()] ^= static_cast<char>(1U << random() % 8);
    }
    for (const char* end : {"", "-wal", "-shm"})
      std::filesystem::remove(folder_ / ("copy" + std::string(end)));
    std::ofstream(folder_ / "copy", std::ios::binary) << damaged;
    auto file = MapFile::open(folder_ / "copy");
    if (!file) continue;
    const StoredMap stored = file->load();
    if (!stored.damage.empty() || bytes_of(stored.record) == sound) continue;
    const auto restored = MapMaker::restore(stored.record, {header_.id, "", Epoch{4}}, options_);
    EXPECT_TRUE(!restored || !restored->repairs.empty()) << "a row was lost without a word";
  }
}

/// Files of this process may not grow beyond the limit while it lives: a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() { setrlimit(RLIMIT_FSIZE, &before_); }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
};

TEST_F(MapFileTest, AFullDiskIsAnErrorAndLosesNothing) {
  keep();
  const std::vector<uint8_t> before = bytes_of(load().record);
  auto file = MapFile::open(path_);
  ASSERT_TRUE(file);
  ASSERT_EQ(offer(8).verdict, KeyframeVerdict::kAccepted);
  const MapUpdate update = take_update();
  {
    const FileSizeLimit limit(64 << 10);
    const Status written = file->write({&update, 1});
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::kIo);
    EXPECT_THAT(written.error().message, HasSubstr(path_.string()));
    EXPECT_TRUE(bytes_of(file->load().record) == before);
  }
  const Status written = file->write({&update, 1});
  ASSERT_TRUE(written) << written.error().message;
  EXPECT_TRUE(bytes_of(file->load().record) == bytes_of(whole()));
}

}  // namespace
}  // namespace cairn
