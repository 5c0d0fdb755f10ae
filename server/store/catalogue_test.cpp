// SPDX-License-Identifier: Apache-2.0
// The store's catalogue: what it keeps beside the maps, and that no map is lost with it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>
#include <vector>

#include "server/store/entry_codec.h"
#include "server/store/store_fixture.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using CatalogueTest = testing::StoreFixture;

TEST_F(CatalogueTest, ADamagedCatalogueIsSetAsideAndTheMapsStay) {
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

TEST_F(CatalogueTest, ACatalogueThatIsCutOffIsBegunAnewAndNotSilently) {
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

TEST_F(CatalogueTest, OverlapsAreKeptThroughStarts) {
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

TEST_F(CatalogueTest, ADamagedOverlapCostsNoOtherAndNothingElse) {
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

TEST_F(CatalogueTest, ACatalogueOfTheFirstSchemaIsBroughtUpToDate) {
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

}  // namespace
}  // namespace cairn
