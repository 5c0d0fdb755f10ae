// SPDX-License-Identifier: Apache-2.0
// The store at work: what is damaged costs what it held and nothing else, and trouble is the trouble of whom
// it belongs to.
#include "server/service/map_persistence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <fstream>
#include <future>
#include <sstream>

#include "server/service/by_hand.h"
#include "server/service/store_threads.h"
#include "server/service/system_clock.h"
#include "server/service/worker_pool.h"
#include "server/store/kept_map_fixture.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kNeverYield;
using ::testing::SizeIs;

constexpr std::chrono::seconds kDeadline{60};
constexpr int kThreads = 2;

class MapPersistenceTest : public testing::KeptMapFixture {
 protected:
  [[nodiscard]] std::unique_ptr<MapPersistence> open() const {
    auto store = MapPersistence::start(folder_, store_threads(null_logger()), null_logger());
    EXPECT_TRUE(store) << store.error().message;
    return store ? std::move(*store) : nullptr;
  }
  /// Six keyframes, a label and a decision.
  void keep_a_map() {
    start();
    for (int step = 5; step <= 14; step += 3) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    MapUpdate update = take_update();
    update.decisions.push_back(decision(1));
    LabelRecord label;
    label.id = 1;
    label.text = "here";
    label.author = "anna";
    update.labels.push_back(label);
    const auto store = Store::open(folder_, null_logger());
    ASSERT_TRUE(store);
    const Status made = (*store)->create(header_, update);
    ASSERT_TRUE(made) << made.error().message;
  }
  [[nodiscard]] std::filesystem::path file() const {
    return folder_ / "maps" / (to_hex(header_.id.bytes) + ".cairnmap");
  }
  void damage(const std::string& table, int64_t row) const {
    auto database = sqlite::Database::open(file(), sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database);
    ASSERT_TRUE(database->execute("UPDATE " + table +
                                  " SET checksum = checksum + 1 WHERE id = " + std::to_string(row)));
  }
  [[nodiscard]] size_t set_aside() const {
    size_t maps = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "damaged"))
      maps += entry.path().extension() == ".cairnmap" ? 1 : 0;
    return maps;
  }
  /// Waits for a map that has come in to be loaded.
  [[nodiscard]] Status restored(MapPersistence* store, MapOpening::Undo undo = &Store::undo_undelete) {
    auto loaded = std::make_shared<std::promise<Status>>();
    store->opening().restore_one(
        header_.id, {options_, {}}, RestoredImages::kStay, undo,
        [loaded](const auto& map) { loaded->set_value(map ? Status() : tl::unexpected(map.error())); });
    return loaded->get_future().get();
  }
  /// Waits for what the writer says of an update.
  [[nodiscard]] static Status written(MapPersistence* store, MapId map, MapUpdate update) {
    auto promise = std::make_shared<std::promise<Status>>();
    auto future = promise->get_future();
    store->write(map, std::move(update), [promise](Status kept) { promise->set_value(std::move(kept)); });
    if (future.wait_for(kDeadline) != std::future_status::ready) throw std::runtime_error("no answer");
    return future.get();
  }
};

/// Turns that come when the test says so.
class TurnsByHand : public Turns {
 public:
  void begin(Turn turn) override { turn_ = std::move(turn); }
  void wake() override {}
  void finish() override { take(); }
  void take() { (void)turn_(); }

 private:
  Turn turn_;
};

/// No exception of the library's: those are kept from the turn by the turn itself.
struct Broken {};

TEST_F(MapPersistenceTest, WhatWaitsBehindATurnThatFailedIsWrittenByTheNext) {
  keep_a_map();
  TasksByHand tasks;
  auto own = std::make_unique<TurnsByHand>();
  TurnsByHand& turns = *own;
  auto store = MapPersistence::start(folder_,
                                     {std::make_shared<SystemClock>(), std::move(own),
                                      std::make_unique<ByHand>(&tasks), std::make_unique<ByHand>(&tasks)},
                                     null_logger());
  ASSERT_TRUE(store) << store.error().message;
  int failures = 0;
  int written = 0;
  const auto note = [&written](const Status& kept) { written += kept ? 1 : 0; };
  (*store)->later([] { throw Broken(); }, std::chrono::milliseconds(0));
  (*store)->run([&](Store&) {
    ++failures;
    throw Broken();
  });
  (*store)->write(header_.id, {}, [](const Status&) { throw Broken(); });
  (*store)->write(header_.id, {}, note);
  (*store)->run([&](Store&) { (*store)->write(header_.id, {}, note); });
  EXPECT_THROW(turns.take(), Broken);
  EXPECT_THROW(turns.take(), Broken);
  EXPECT_THROW(turns.take(), Broken);
  EXPECT_EQ(written, 0);
  (*store)->write(header_.id, {}, note);
  turns.take();
  EXPECT_EQ(written, 3) << "what was left, what that has asked for, and what has come since";
  EXPECT_EQ(failures, 1) << "it is not done twice";
}

struct DamagedRow {
  const char* table;
  int64_t row;
};

class DamagedRowTest : public MapPersistenceTest, public ::testing::WithParamInterface<DamagedRow> {};

TEST_P(DamagedRowTest, CostsWhatItHeldAndTheMapGoesOn) {
  if (GetParam().table == std::string_view("found_cameras")) use_prior(1.02);
  keep_a_map();
  const MapSnapshotPtr before = maker_->snapshot();
  damage(GetParam().table, GetParam().row);
  {
    const auto store = open();
    std::vector<RestoredMap> maps = store->opening().restore({options_, {}}, on_threads(kThreads));
    ASSERT_THAT(maps, SizeIs(1));
    EXPECT_EQ(set_aside(), 1U);
    MapMaker& map = *maps[0].maker;
    const KeyframeInput next = testing::make_offer(scene_, *map.snapshot(), 17);
    ASSERT_EQ(map.add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    while (map.step(kNeverYield).work != MapWork::kNone) {
    }
    EXPECT_EQ(map.snapshot()->keyframe_blocks[0]->keyframes.size(),
              before->keyframe_blocks[0]->keyframes.size() + 1);
    const Status kept = written(store.get(), header_.id, {map.take_changes(), {}, {}, {}});
    EXPECT_TRUE(kept) << kept.error().message;
  }
  const auto store = open();
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), SizeIs(1));
  EXPECT_EQ(set_aside(), 1U) << "what was saved of it is sound";
}

INSTANTIATE_TEST_SUITE_P(EveryTable, DamagedRowTest,
                         ::testing::Values(DamagedRow{"map", 3}, DamagedRow{"epochs", 3},
                                           DamagedRow{"keyframes", 4}, DamagedRow{"images", 4},
                                           DamagedRow{"measurements", 4}, DamagedRow{"sources", 2},
                                           DamagedRow{"positions", 2}, DamagedRow{"decisions", 1},
                                           DamagedRow{"labels", 1}, DamagedRow{"found_cameras", 1}),
                         [](const auto& info) { return std::string(info.param.table); });

class FatalRowTest : public MapPersistenceTest, public ::testing::WithParamInterface<DamagedRow> {};

TEST_P(FatalRowTest, SetsTheMapAside) {
  keep_a_map();
  damage(GetParam().table, GetParam().row);
  const auto store = open();
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  EXPECT_EQ(set_aside(), 1U);
  EXPECT_FALSE(std::filesystem::exists(file()));
}

INSTANTIATE_TEST_SUITE_P(EveryTable, FatalRowTest,
                         ::testing::Values(DamagedRow{"map", 1}, DamagedRow{"map", 2},
                                           DamagedRow{"cameras", 1}, DamagedRow{"keyframes", 1}),
                         [](const auto& info) {
                           return std::string(info.param.table) + std::to_string(info.param.row);
                         });

TEST_F(MapPersistenceTest, AMapThatCannotBeLoadedIsKnownForAsLongAsItsFileLiesThere) {
  keep_a_map();
  const auto set_version = [this](int version) {
    auto database = sqlite::Database::open(file(), sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database->execute("PRAGMA user_version=" + std::to_string(version)));
  };
  set_version(99);
  const MapId unreadable{{9}};
  const std::filesystem::path no_file = folder_ / "maps" / (to_hex(unreadable.bytes) + ".cairnmap");
  std::filesystem::create_directory(no_file);  // reading it is an I/O error
  const auto store = open();
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  EXPECT_EQ(set_aside(), 0U);
  const std::vector<UnloadedMap> both = store->opening().unloaded();
  ASSERT_THAT(both, SizeIs(2));
  const bool in_order = both[0].map == header_.id;
  const UnloadedMap& newer = both[in_order ? 0 : 1];
  EXPECT_EQ(newer.map, header_.id);
  EXPECT_EQ(newer.file, file());
  EXPECT_THAT(newer.reason, HasSubstr("install that version"));
  EXPECT_EQ(both[in_order ? 1 : 0].map, unreadable);
  EXPECT_TRUE(std::filesystem::exists(file()));

  std::filesystem::remove(no_file);
  EXPECT_THAT(store->opening().unloaded(), SizeIs(1));
  set_version(map_schema_version());
  EXPECT_TRUE(restored(store.get()));
  EXPECT_THAT(store->opening().unloaded(), IsEmpty()) << "it is served";
}

/// Refused means unchanged.
TEST_F(MapPersistenceTest, AMapThatCannotBeLoadedGoesBackToWhereItCameFrom) {
  keep_a_map();
  const std::filesystem::path deleted = folder_ / "deleted" / file().filename();
  const std::filesystem::path archive = folder_ / "copy";
  std::filesystem::copy_file(file(), archive);
  std::filesystem::rename(file(), deleted);
  const auto store = open();
  // It cannot be read now, or never: `map` row 2 is what it stands on.
  for (const char* problem :
       {"PRAGMA user_version=99", "UPDATE map SET checksum = checksum + 1 WHERE id = 2"}) {
    SCOPED_TRACE(problem);
    std::filesystem::copy_file(archive, deleted, std::filesystem::copy_options::overwrite_existing);
    ASSERT_TRUE(sqlite::Database::open(deleted, sqlite::OpenMode::kReadWrite)->execute(problem));
    store->run_on_strand([&](Store& s) { EXPECT_TRUE(s.undelete(header_.id)); });
    std::promise<Status> refused;
    store->run_on_strand([&](Store&) { refused.set_value(restored(store.get())); });
    EXPECT_FALSE(refused.get_future().get());
    EXPECT_TRUE(std::filesystem::exists(deleted));
    EXPECT_FALSE(std::filesystem::exists(file()));
  }
  EXPECT_THAT(store->opening().unloaded(), IsEmpty());
  EXPECT_EQ(set_aside(), 0U);
  std::filesystem::rename(deleted, file());
  EXPECT_FALSE(restored(store.get(), &Store::undo_import));
  EXPECT_FALSE(std::filesystem::exists(file())) << "the operator has the archive";
  std::filesystem::copy_file(archive, file());
  EXPECT_TRUE(restored(store.get(), &Store::undo_import));
}

TEST_F(MapPersistenceTest, AMapThatCouldNotBePutIntoItsPlaceIsKnown) {
  keep_a_map();
  const std::filesystem::path saved = std::filesystem::path(file()).replace_extension(".saved");
  std::filesystem::rename(file(), saved);
  std::filesystem::create_symlink(folder_ / "elsewhere" / "map", file());
  const auto store = open();
  std::filesystem::remove(file());
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  const std::vector<UnloadedMap> unloaded = store->opening().unloaded();
  ASSERT_THAT(unloaded, SizeIs(1));
  EXPECT_EQ(unloaded[0].map, header_.id);
  EXPECT_EQ(unloaded[0].file, saved);
  std::filesystem::remove(saved);
  EXPECT_THAT(store->opening().unloaded(), IsEmpty());
}

TEST_F(MapPersistenceTest, AMapBehindALinkIntoNowhereIsKnown) {
  keep_a_map();
  std::filesystem::remove(file());
  std::filesystem::create_symlink(folder_ / "elsewhere" / "map", file());
  const auto store = open();
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  EXPECT_THAT(store->opening().unloaded(), SizeIs(1));
}

TEST_F(MapPersistenceTest, WhatCannotBeSetAsideIsLoggedOnceAndLeftAlone) {
  keep_a_map();
  damage("map", 1);
  std::ostringstream said;
  const auto log =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said));
  const auto store = MapPersistence::start(folder_, store_threads(log), log);
  ASSERT_TRUE(store);
  std::filesystem::remove(folder_ / "damaged");
  EXPECT_THAT((*store)->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  EXPECT_THAT((*store)->opening().unloaded(), SizeIs(1));
  const std::string text = said.str();
  const size_t first = text.find("table map, row 1");
  ASSERT_NE(first, std::string::npos) << text;
  EXPECT_EQ(text.find("table map, row 1", first + 1), std::string::npos) << text;
}

TEST_F(MapPersistenceTest, AnEmptiedFileIsSetAsideWithItsLogAndNamed) {
  keep_a_map();
  std::filesystem::resize_file(file(), 0);
  std::ofstream(file().string() + "-wal") << "perhaps all of it";
  const auto store = open();
  EXPECT_THAT(store->opening().restore({options_, {}}, on_threads(kThreads)), IsEmpty());
  const std::vector<DamagedFile> damaged = store->opening().damaged_files();
  ASSERT_THAT(damaged, SizeIs(1));
  EXPECT_EQ(damaged[0].map, header_.id);
  ASSERT_THAT(damaged[0].reasons, SizeIs(1));
  EXPECT_THAT(damaged[0].reasons[0], HasSubstr("0 bytes"));
  EXPECT_TRUE(std::filesystem::exists(damaged[0].path.string() + "-wal"));
  EXPECT_FALSE(std::filesystem::exists(file()));
}

TEST_F(MapPersistenceTest, WhatHasNothingToDoComesBackIndexedAndWithoutImages) {
  keep_a_map();
  const size_t bytes = maker_->statistics().bytes;
  {
    const auto store = open();
    const std::vector<RestoredMap> maps =
        store->opening().restore({options_, {}}, on_threads(kThreads), RestoredImages::kEvicted);
    ASSERT_THAT(maps, SizeIs(1));
    EXPECT_EQ(maps[0].maker->statistics().without_images, 0U) << "a global adjustment is due";
    adjust_globally();
    const Status kept = written(store.get(), header_.id, take_update());
    ASSERT_TRUE(kept) << kept.error().message;
  }
  const auto store = open();
  const std::vector<RestoredMap> maps =
      store->opening().restore({options_, {}}, on_threads(kThreads), RestoredImages::kEvicted);
  ASSERT_THAT(maps, SizeIs(1));
  MapMaker& map = *maps[0].maker;
  EXPECT_FALSE(map.has_work());
  EXPECT_EQ(map.statistics().without_images, 6U);
  EXPECT_LT(2 * map.statistics().bytes, bytes);
  EXPECT_EQ(maps[0].indexed->snapshot->revision, map.snapshot()->revision);
  EXPECT_EQ(maps[0].indexed->keyframes.size(), 6U);
  EXPECT_TRUE(map.take_changes().empty());

  auto read = std::make_shared<std::promise<Result<std::vector<ImageRow>>>>();
  store->read_images(header_.id, map.lacking_images(),
                     [read](auto rows) { read->set_value(std::move(rows)); });
  const auto rows = read->get_future().get();
  ASSERT_TRUE(rows) << rows.error().message;
  for (const ImageRow& row : *rows)
    EXPECT_TRUE(map.page_in_image(row.keyframe, decode_image_row(row.data)->view()));
  EXPECT_EQ(map.statistics().without_images, 0U);
  const KeyframeInput next = testing::make_offer(scene_, *map.snapshot(), 17);
  for (MapMaker* maker : {maker_.get(), &map}) {
    ASSERT_EQ(maker->add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    while (maker->step(kNeverYield).work != MapWork::kNone) {
    }
    maker->keep_everything_anew();
  }
  EXPECT_TRUE(testing::bytes_of(map.take_changes()) == testing::bytes_of(maker_->take_changes()));
}

TEST_F(MapPersistenceTest, WhoeverFailsAtWhatHasBeenReadTakesNobodyWithIt) {
  keep_a_map();
  const auto store = open();
  store->read_images(header_.id, {KeyframeId{1}}, [](const auto&) { throw std::runtime_error("no room"); });
  auto read = std::make_shared<std::promise<Result<std::vector<ImageRow>>>>();
  store->read_images(header_.id, {KeyframeId{1}}, [read](auto rows) { read->set_value(std::move(rows)); });
  auto answer = read->get_future();
  ASSERT_EQ(answer.wait_for(kDeadline), std::future_status::ready);
  EXPECT_TRUE(answer.get());
}

TEST_F(MapPersistenceTest, WhatIsWrongWithOneMapIsNoTroubleOfTheStore) {
  keep_a_map();
  const auto store = open();
  const Status lost = written(store.get(), MapId{{9}}, {});
  ASSERT_FALSE(lost);
  EXPECT_EQ(lost.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(store->trouble(), IsEmpty());
  EXPECT_TRUE(written(store.get(), header_.id, {}));
}

TEST_F(MapPersistenceTest, AJobThatThrowsCostsNoOther) {
  keep_a_map();
  const auto store = open();
  std::promise<void> release;
  store->run([&](Store&) { release.get_future().wait(); });  // what follows is one batch
  store->run([](Store&) { throw std::runtime_error("broken"); });
  auto after = std::make_shared<std::promise<Status>>();
  store->write(header_.id, {}, [](const Status&) { throw std::runtime_error("broken"); });
  store->write(header_.id, {}, [after](Status kept) { after->set_value(std::move(kept)); });
  release.set_value();
  auto kept = after->get_future();
  ASSERT_EQ(kept.wait_for(kDeadline), std::future_status::ready);
  EXPECT_TRUE(kept.get());
}

}  // namespace
}  // namespace cairn
