// SPDX-License-Identifier: Apache-2.0
#include "server/store/site_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class SiteFileTest : public ::testing::Test {
 protected:
  SiteFileTest() {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  [[nodiscard]] SiteFile open() const {
    auto file = SiteFile::open(path_);
    if (!file) throw std::runtime_error(file.error().message);
    return std::move(*file);
  }
  static AuditEntry entry(int64_t time, const char* who, const char* action, const char* object = "") {
    return {0, {time}, who, action, object, "done"};
  }
  /// The times of what is found.
  static std::vector<int64_t> times(SiteFile* file, const AuditQuery& query) {
    std::vector<int64_t> found;
    const auto entries = file->find(query);
    EXPECT_TRUE(entries);
    for (const AuditEntry& e : *entries) found.push_back(e.time.nanoseconds);
    return found;
  }
  const std::filesystem::path folder_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string("site_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
  const std::filesystem::path path_ = folder_ / "site.db";
};

TEST_F(SiteFileTest, WhatWasKeptIsThereAtTheNextStart) {
  {
    SiteFile file = open();
    EXPECT_EQ(*file.rights(), std::nullopt);
    ASSERT_TRUE(file.keep_rights("first", entry(1, "operator ann", "rights grant", "client bob")));
    ASSERT_TRUE(file.keep_rights("second", entry(2, "operator ann", "rights revoke", "client bob")));
  }
  SiteFile file = open();
  EXPECT_EQ(*file.rights(), "second");
  const auto entries = file.find({});
  ASSERT_TRUE(entries);
  ASSERT_EQ(entries->size(), 2U);
  EXPECT_EQ(entries->at(0), (AuditEntry{2, {2}, "operator ann", "rights revoke", "client bob", "done"}));
}

TEST_F(SiteFileTest, WhoseKeysItWasUsedWithIsKept) {
  {
    SiteFile file = open();
    EXPECT_EQ(*file.authority(), std::nullopt);
    ASSERT_TRUE(file.keep_authority("aaaa", std::nullopt));
  }
  SiteFile file = open();
  EXPECT_EQ(*file.authority(), "aaaa");
  EXPECT_THAT(times(&file, {}), IsEmpty());
  ASSERT_TRUE(file.keep_authority("bbbb", entry(7, "server", "other keys")));
  EXPECT_EQ(*file.authority(), "bbbb");
  EXPECT_THAT(times(&file, {}), ElementsAre(7));
}

TEST_F(SiteFileTest, EntriesAreFoundByWhoActionObjectAndTimeTheNewestFirst) {
  SiteFile file = open();
  const std::vector<AuditEntry> entries{entry(10, "operator ann", "rights grant", "client bob"),
                                        entry(20, "client ann-2", "connect"),
                                        entry(30, "operator bob", "rights grant", "map 100% desk"),
                                        entry(40, "operator ann", "map delete", "map desk_1")};
  ASSERT_TRUE(file.append(entries));
  EXPECT_THAT(times(&file, {}), ElementsAre(40, 30, 20, 10));
  AuditQuery query;
  query.who = "ann";
  EXPECT_THAT(times(&file, query), ElementsAre(40, 10));
  query.who = "operator ann";
  EXPECT_THAT(times(&file, query), ElementsAre(40, 10));
  query.who = "a%";
  EXPECT_THAT(times(&file, query), IsEmpty()) << "what is looked for stands for itself";
  query = {};
  query.action = "rights";
  EXPECT_THAT(times(&file, query), ElementsAre(30, 10));
  query = {};
  query.object = "0% d";
  EXPECT_THAT(times(&file, query), ElementsAre(30));
  query = {};
  query.from = Timestamp{20};
  query.until = Timestamp{40};
  EXPECT_THAT(times(&file, query), ElementsAre(30, 20));
}

TEST_F(SiteFileTest, PagesFollowEachOtherWithoutGapOrRepetition) {
  SiteFile file = open();
  for (int i = 1; i <= 25; ++i) ASSERT_TRUE(file.append(std::vector{entry(i, "server", "start")}));
  AuditQuery query;
  query.limit = 10;
  std::vector<int64_t> all;
  while (true) {
    const auto page = file.find(query);
    ASSERT_TRUE(page);
    if (page->empty()) break;
    for (const AuditEntry& e : *page) all.push_back(e.time.nanoseconds);
    query.before_number = page->back().number;
  }
  ASSERT_EQ(all.size(), 25U);
  EXPECT_TRUE(std::is_sorted(all.rbegin(), all.rend()));
}

TEST_F(SiteFileTest, TheOldestGoFirstAndNumbersAreNotGivenAgain) {
  SiteFile file = open();
  for (int i = 1; i <= 10; ++i) ASSERT_TRUE(file.append(std::vector{entry(i, "server", "start")}));
  EXPECT_EQ(*file.prune(10), 0);
  EXPECT_EQ(*file.prune(3), 7);
  EXPECT_THAT(times(&file, {}), ElementsAre(10, 9, 8));
  ASSERT_TRUE(file.append(std::vector{entry(11, "server", "start")}));
  EXPECT_EQ(file.find({})->front().number, 11);
}

/// However many labels a client places: what others did stays.
TEST_F(SiteFileTest, WhoHasMostEntriesLosesTheOldest) {
  SiteFile file = open();
  const auto append = [&](int from, int until, const char* who) {
    for (int i = from; i <= until; ++i) ASSERT_TRUE(file.append(std::vector{entry(i, who, "label place")}));
  };
  append(1, 3, "operator ann");
  append(4, 5, "client tablet");
  append(6, 15, "client phone");
  EXPECT_EQ(*file.prune(8), 7);
  EXPECT_THAT(times(&file, {}), ElementsAre(15, 14, 13, 5, 4, 3, 2, 1));
  append(16, 22, "operator ann");
  EXPECT_EQ(*file.prune(8), 7);
  EXPECT_THAT(times(&file, {}), ElementsAre(22, 21, 20, 15, 14, 13, 5, 4));
}

/// A disk that is full for a while, say.
TEST_F(SiteFileTest, WhatCouldNotBeRemovedIsRemovedTheNextTime) {
  SiteFile file = open();
  for (int i = 1; i <= 10; ++i) ASSERT_TRUE(file.append(std::vector{entry(i, "server", "start")}));
  const auto execute = [this](const char* sql) {
    auto database = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database && database->execute(sql));
  };
  execute(
      "CREATE TRIGGER full BEFORE DELETE ON audit WHEN old.number = 2 BEGIN SELECT RAISE(ABORT, 'full'); END");
  EXPECT_FALSE(file.prune(3));
  execute("DROP TRIGGER full");
  EXPECT_EQ(*file.prune(3), 7);
}

TEST_F(SiteFileTest, RightsThatWereChangedByAnotherHandAreDamaged) {
  {
    SiteFile file = open();
    ASSERT_TRUE(file.keep_rights("deny", entry(1, "operator ann", "rights revoke")));
  }
  {
    auto database = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database);
    ASSERT_TRUE(database->execute("UPDATE rights SET data = x'616c6c'"));
  }
  const auto rights = open().rights();
  ASSERT_FALSE(rights);
  EXPECT_EQ(rights.error().code, ErrorCode::kDamaged);
}

TEST_F(SiteFileTest, AFileThatIsNoneOrHoldsMoreIsRefused) {
  {
    std::ofstream(path_) << "no database, but long enough to be looked at as if it were one";
    const auto file = SiteFile::open(path_);
    ASSERT_FALSE(file);
    EXPECT_EQ(file.error().code, ErrorCode::kDamaged);
  }
  std::filesystem::remove(path_);
  {
    SiteFile file = open();
    ASSERT_TRUE(file.keep_rights("deny", entry(1, "operator ann", "rights revoke")));
  }
  {
    auto database = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database);
    ASSERT_TRUE(database->execute(
        "CREATE TRIGGER sly AFTER INSERT ON audit BEGIN DELETE FROM audit WHERE number = NEW.number; END"));
  }
  const auto file = SiteFile::open(path_);
  ASSERT_FALSE(file);
  EXPECT_THAT(file.error().message, HasSubstr("holds what no"));
}

}  // namespace
}  // namespace cairn
