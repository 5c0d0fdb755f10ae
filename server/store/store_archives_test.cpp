// SPDX-License-Identifier: Apache-2.0
// Maps that leave a store as a file, and come into one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "server/store/store_fixture.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

using StoreArchivesTest = testing::StoreFixture;

TEST_F(StoreArchivesTest, AnArchiveWithAViewInPlaceOfATableIsRefused) {
  const auto store = open();
  keep(store.get());
  const std::filesystem::path archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store->export_map(header_.id, archive));
  ASSERT_TRUE(store->remove(header_.id));
  ASSERT_TRUE(store->purge(header_.id));
  const char* tamperings[] = {
      "ALTER TABLE keyframes RENAME TO k; CREATE VIEW keyframes AS WITH RECURSIVE r(id) AS (SELECT 1 UNION "
      "ALL SELECT id + 1 FROM r) SELECT id, x'00' AS data, 0 AS checksum FROM r",
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

TEST_F(StoreArchivesTest, AnImportedMapTakesNoLogThatLiesInItsPlace) {
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

TEST_F(StoreArchivesTest, AnArchiveIsJudgedByWhatItsImagesTakeAsDecoded) {
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

TEST_F(StoreArchivesTest, AnArchiveImportsIntoAnotherStore) {
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
