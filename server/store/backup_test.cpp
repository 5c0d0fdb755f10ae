// SPDX-License-Identifier: Apache-2.0
// Backups of a store: what comes out is what was there, or it is refused by name.
#include "server/store/backup.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/resource.h>
#include <sys/stat.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <random>
#include <thread>

#include "server/mapping/map_maker.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/site_file.h"
#include "server/store/sqlite.h"
#include "server/store/store.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using testing::bytes_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class BackupTest : public testing::KeptMapFixture {
 protected:
  /// A store with a map that is served, one that is deleted, a tag and rights.
  void keep() {
    store_ = *Store::open(home_, null_logger());
    start();
    MapUpdate whole = take_update();
    whole.labels = {{1, "vice", SE3(), "anna", Timestamp{5}}};
    ASSERT_TRUE(store_->create(header_, whole));
    ASSERT_TRUE(store_->tag(header_.id, {0, "monday", {}, "operator ann", 2, 100, 0, 0}));
    MapHeader other = header_;
    other.id = gone_;
    ASSERT_TRUE(store_->create(other, {this->whole(), {}, {}, {}}));
    ASSERT_TRUE(store_->remove(gone_));
    auto site = SiteFile::open(home_ / "site.db");
    ASSERT_TRUE(site->keep_rights("the rights", {0, {}, "operator ann", "rights default", "", "done"}));
  }
  void back_up() {
    auto writer = BackupWriter::create(backup_);
    ASSERT_TRUE(writer) << writer.error().message;
    const auto parts = parts_of_store(home_);
    ASSERT_TRUE(parts);
    for (const std::string& part : *parts) {
      const fs::path copy = folder_ / "copy";
      ASSERT_TRUE(copy_part(home_, part, copy));
      ASSERT_TRUE(writer->add(part, copy));
      fs::remove(copy);
    }
    ASSERT_TRUE(writer->finish(Timestamp{9}, "1.0"));
  }
  [[nodiscard]] Status restore() {
    fs::create_directories(unpacked_);
    const auto content = read_backup(backup_, unpacked_, {});
    if (!content) return tl::unexpected(content.error());
    return settle_restored(unpacked_, restored_, {}, "operator bob");
  }
  [[nodiscard]] std::string content_of_backup() const {
    std::ifstream in(backup_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const fs::path home_ = folder_ / "home";
  const fs::path backup_ = folder_ / "monday.backup";
  const fs::path unpacked_ = folder_ / "restored.part";
  const fs::path restored_ = folder_ / "restored";
  const MapId gone_{{8, 8}};
  std::unique_ptr<Store> store_;
};

TEST_F(BackupTest, WhatIsRestoredIsWhatThereWas) {
  keep();
  const std::string id = to_hex(header_.id.bytes);
  EXPECT_THAT(*parts_of_store(home_),
              ElementsAre("maps/" + id + ".cairnmap", "deleted/" + to_hex(gone_.bytes) + ".cairnmap",
                          "catalogue.db", "site.db"));
  back_up();
  const std::vector<uint8_t> before = bytes_of(store_->load(header_.id)->record);
  const ServerId server = store_->server();
  store_.reset();
  fs::remove_all(home_);
  const Status restored = restore();
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_FALSE(fs::exists(unpacked_));
  const auto store = *Store::open(restored_, null_logger());
  EXPECT_EQ(store->server(), server);
  EXPECT_THAT(store->deleted_ids(), ElementsAre(gone_));
  const auto map = store->load(header_.id);
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_TRUE(bytes_of(map->record) == before);
  EXPECT_THAT(map->labels, SizeIs(1));
  EXPECT_THAT(*store->tags(header_.id), SizeIs(1));
  auto site = SiteFile::open(restored_ / "site.db");
  EXPECT_EQ(**site->rights(), "the rights");
  const auto audit = *site->find({});
  ASSERT_THAT(audit, SizeIs(2));
  EXPECT_EQ(audit[0].action, "restore");
  EXPECT_EQ(audit[0].who, "operator bob");
}

TEST_F(BackupTest, OneThatIsCutOrAlteredAnywhereIsRefusedByName) {
  keep();
  back_up();
  const std::string sound = content_of_backup();
  constexpr unsigned kSeed = 5;
  std::mt19937 random(kSeed);
  for (int i = 0; i < 60; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", case " << i);
    std::string damaged = sound;
    const size_t at = i == 0 ? sound.size() - 1 : random() % sound.size();
    switch (i % 3) {
      case 0:
        damaged.resize(at);
        break;
      case 1:
        damaged[at] ^= static_cast<char>(1U << random() % 8);
        break;
      default:
        damaged.insert(at, 1, '\0');
    }
    std::ofstream(backup_, std::ios::binary) << damaged;
    const auto read = read_backup(backup_, std::nullopt, {});
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(read.error().message, HasSubstr(backup_.string()));
  }
  std::ofstream(backup_, std::ios::binary) << sound;
  EXPECT_TRUE(read_backup(backup_, std::nullopt, {}));
}

TEST_F(BackupTest, NothingIsReplacedAndNothingElseIsUnpacked) {
  keep();
  back_up();
  EXPECT_EQ(BackupWriter::create(backup_).error().code, ErrorCode::kRefused);
  for (const char* name : {"../site.db", "maps/../site.db", "maps/x.cairnmap", "lock", "", "maps/"})
    EXPECT_FALSE(is_backup_part(name)) << name;
  fs::create_directories(restored_ / "maps");
  EXPECT_FALSE(restore()) << "the folder is not empty";
}

TEST_F(BackupTest, WithoutRightsOrTheServersIdItIsNoStore) {
  keep();
  auto writer = BackupWriter::create(backup_);
  ASSERT_TRUE(copy_part(home_, "catalogue.db", folder_ / "copy"));
  ASSERT_TRUE(writer->add("catalogue.db", folder_ / "copy"));
  const Status finished = writer->finish(Timestamp{9}, "1.0");
  ASSERT_FALSE(finished);
  EXPECT_THAT(finished.error().message, HasSubstr("site.db is missing"));
  fs::create_directories(unpacked_);
  fs::rename(folder_ / "copy", unpacked_ / "catalogue.db");
  EXPECT_FALSE(settle_restored(unpacked_, restored_, {}, "operator bob"));
  EXPECT_FALSE(fs::exists(unpacked_ / "site.db")) << "rights that nobody gave";
}

TEST_F(BackupTest, WhatIsRestoredIsForItsOwnerAndGroupWhateverTheUmask) {
  keep();
  back_up();
  const mode_t before = ::umask(0);
  const Status restored = restore();
  ::umask(before);
  ASSERT_TRUE(restored) << restored.error().message;
  const auto may = [](const fs::path& path) { return static_cast<unsigned>(fs::status(path).permissions()); };
  EXPECT_EQ(may(restored_), 0750U);
  for (const auto& entry : fs::recursive_directory_iterator(restored_))
    EXPECT_EQ(may(entry.path()), entry.is_directory() ? 0750U : 0640U) << entry.path();
}

TEST_F(BackupTest, APartThatHasGoneHasItsPlaceInTheListStill) {
  const std::vector<std::string> parts{
      "maps/" + std::string(32, 'b') + ".cairnmap", "deleted/" + std::string(32, 'a') + ".cairnmap",
      "deleted/" + std::string(32, 'c') + ".cairnmap", "catalogue.db", "site.db"};
  for (size_t i = 0; i < parts.size(); ++i) {
    for (size_t j = 0; j < parts.size(); ++j) EXPECT_EQ(comes_later(parts[i], parts[j]), i > j);
  }
  keep();
  const auto listed = *parts_of_store(home_);
  for (size_t i = 1; i < listed.size(); ++i) EXPECT_TRUE(comes_later(listed[i], listed[i - 1]));
}

/// Whoever reads the header at one moment and the rest at another finds faults that there are not.
TEST_F(BackupTest, AMapThatIsBeingWrittenIsSoundAndCopiedAsOfOneMoment) {
  keep();
  const std::string part = "maps/" + to_hex(header_.id.bytes) + ".cairnmap";
  std::atomic<bool> is_written{false};
  std::thread writer([&] {
    auto file = MapFile::open(home_ / part);
    for (uint64_t epoch = 100; epoch < 200 && file; ++epoch) EXPECT_TRUE(file->begin_epoch(Epoch{epoch}));
    is_written = true;
  });
  size_t looks = 0;
  while (!is_written || looks == 0) {
    const FileCheck check = check_part(home_, part, {}, FileInUse::kYes);
    EXPECT_THAT(check.faults, IsEmpty());
    if (!check.faults.empty()) break;
    ++looks;
  }
  writer.join();
  RecordProperty("looks", std::to_string(looks));
}

/// A file cannot be opened where no log can be made beside it: that is no damage.
TEST_F(BackupTest, WhatTheDiskDoesNotLetBeCheckedIsNotDamaged) {
  keep();
  const std::string map = "maps/" + to_hex(header_.id.bytes) + ".cairnmap";
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit full{0, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &full);
  std::vector<FileCheck> checks;
  for (const std::string& part : {map, std::string("catalogue.db"), std::string("site.db")})
    checks.push_back(check_part(home_, part, {}));
  setrlimit(RLIMIT_FSIZE, &before);
  for (const FileCheck& check : checks) {
    EXPECT_THAT(check.faults, IsEmpty());
    EXPECT_EQ(check.remedy, "");
  }
  EXPECT_THAT(checks[1].not_checked, HasSubstr("catalogue.db"));
  EXPECT_THAT(checks[2].not_checked, HasSubstr("site.db"));
}

TEST_F(BackupTest, AFaultIsSaidWithItsFileRowAndRemedy) {
  keep();
  const std::string part = "maps/" + to_hex(header_.id.bytes) + ".cairnmap";
  const FileCheck sound = check_part(home_, part, {});
  EXPECT_THAT(sound.faults, IsEmpty());
  EXPECT_EQ(sound.name, "desk");
  EXPECT_EQ(sound.keyframes, 2U);
  EXPECT_EQ(sound.labels, 1U);
  EXPECT_EQ(sound.tags, 1U);
  for (const auto& [sql, says] :
       {std::pair("UPDATE positions SET checksum = checksum + 1 WHERE id = 1", "table positions, row 1"),
        std::pair("UPDATE images SET checksum = checksum + 1 WHERE id = 2", "table images, row 2"),
        std::pair("DELETE FROM measurements WHERE id = 2", "fewer than two of its keyframes are left"),
        std::pair("DELETE FROM keyframes WHERE id = 1", "its first keyframe is lost"),
        std::pair("UPDATE tags SET checksum = checksum + 1", "table tags, row 1"),
        std::pair("DELETE FROM epochs", "its last epoch")}) {
    fs::create_directories(folder_ / "other/maps");
    fs::remove(folder_ / "other" / part);
    ASSERT_TRUE(copy_part(home_, part, folder_ / "other" / part));
    ASSERT_TRUE(sqlite::Database::open(folder_ / "other" / part, sqlite::OpenMode::kReadWrite)->execute(sql));
    const FileCheck check = check_part(folder_ / "other", part, {});
    ASSERT_FALSE(check.faults.empty()) << sql;
    EXPECT_THAT(::testing::PrintToString(check.faults), HasSubstr(says));
    EXPECT_THAT(check.faults[0], HasSubstr(part));
    EXPECT_THAT(check.remedy, HasSubstr("backup"));
  }
  EXPECT_THAT(check_part(home_, "site.db", {}).faults, IsEmpty());
  EXPECT_THAT(check_part(home_, "catalogue.db", {}).faults, IsEmpty());
  const auto refuse = [](const std::string& text) { return fail(ErrorCode::kDamaged, text + "?"); };
  EXPECT_THAT(check_part(home_, "site.db", refuse).faults, ElementsAre(HasSubstr("the rights?")));
}

}  // namespace
}  // namespace cairn
