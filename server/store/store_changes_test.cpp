// SPDX-License-Identifier: Apache-2.0
// What becomes of a map in a store: its epoch never comes again, and a change that is refused is none.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <map>

#include "server/store/kept_map_fixture.h"
#include "server/store/os_reason.h"
#include "server/store/store.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr uint64_t kTenYears = 315'360'000'000;  ///< [ms]

class StoreChangesTest : public testing::KeptMapFixture {
 protected:
  StoreChangesTest() { std::signal(SIGXFSZ, SIG_IGN); }
  ~StoreChangesTest() override { limit_files(RLIM_INFINITY); }

  void open() {
    store_.reset();
    auto store = Store::open(folder_, null_logger());
    ASSERT_TRUE(store) << store.error().message;
    store_ = std::move(*store);
  }
  void keep() {
    start();
    header_.epoch = Epoch{store_->start_count()};  // as a new map is served
    last_served_ = header_.epoch;
    const Status made = store_->create(header_, take_update());
    ASSERT_TRUE(made) << made.error().message;
  }
  [[nodiscard]] fs::path archive(const char* name) const { return folder_ / name; }
  void import(const fs::path& archive) {
    const auto imported = store_->import_map(archive);
    ASSERT_TRUE(imported) << imported.error().message;
  }
  void purge() {
    ASSERT_TRUE(store_->remove(header_.id));
    ASSERT_TRUE(store_->purge(header_.id));
  }
  /// Serves the map; expects an epoch that nobody has seen it in.
  void serve() {
    const auto map = store_->load(header_.id);
    ASSERT_TRUE(map) << map.error().message;
    EXPECT_GT(map->header.epoch, last_served_);
    EXPECT_EQ(map->epochs.back().epoch, map->header.epoch);
    last_served_ = map->header.epoch;
  }
  [[nodiscard]] fs::path place(const char* part) const {
    return folder_ / part / (to_hex(header_.id.bytes) + ".cairnmap");
  }
  static void limit_files(rlim_t bytes) {
    const rlimit limit{bytes, RLIM_INFINITY};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  /// All that lies in the store, with what is in it.
  [[nodiscard]] std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_)) {
      std::string& content = files[entry.path().string()];
      if (!entry.is_regular_file()) continue;
      std::ifstream in(entry.path(), std::ios::binary);
      content = {std::istreambuf_iterator<char>(in), {}};
    }
    return files;
  }

  std::unique_ptr<Store> store_;
  Epoch last_served_;
};

// ---- epochs

TEST_F(StoreChangesTest, AMapThatComesBackIsServedInAnEpochOfItsOwn) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("yesterday")));
  open();
  serve();
  ASSERT_TRUE(store_->export_map(header_.id, archive("today")));
  for (const char* copy : {"yesterday", "today", "yesterday"}) {
    SCOPED_TRACE(copy);
    purge();
    import(archive(copy));
    serve();
    ASSERT_TRUE(store_->remove(header_.id));
    ASSERT_TRUE(store_->undelete(header_.id));
    serve();
  }
  open();
  serve();
}

TEST_F(StoreChangesTest, AMapThatWasMadeAndPurgedInOneStartComesBackInALaterEpoch) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("copy")));
  purge();
  import(archive("copy"));
  serve();
}

TEST_F(StoreChangesTest, EpochsOfPurgedMapsAreKnownToLaterStarts) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("old")));
  purge();
  // From a computer whose clock is ahead.
  const Epoch ahead{last_served_.value + kTenYears};
  auto file =
      MapFile::create(archive("ahead"), {header_.id, "desk", ahead, false, {}}, {whole(), {}, {}, {}});
  ASSERT_TRUE(file && file->write_back());
  import(archive("ahead"));
  serve();
  EXPECT_GT(last_served_, ahead);
  purge();
  open();
  EXPECT_GT(store_->start_count(), last_served_.value) << "whatever is made now, under whatever id";
  import(archive("old"));
  serve();
}

TEST_F(StoreChangesTest, AnOlderCopyPutInPlaceByHandIsServedInALaterEpoch) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("old")));
  open();
  serve();
  ASSERT_TRUE(store_->remove(header_.id));
  fs::copy_file(archive("old"), place("deleted"), fs::copy_options::overwrite_existing);
  ASSERT_TRUE(store_->undelete(header_.id));
  serve();
  store_.reset();
  fs::copy_file(archive("old"), place("maps"), fs::copy_options::overwrite_existing);
  open();
  serve();
}

TEST_F(StoreChangesTest, AnEpochThatCannotBeKeptIsNotGiven) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("copy")));
  purge();
  import(archive("copy"));
  const fs::path catalogue = folder_ / "catalogue.db";
  fs::rename(catalogue, folder_ / "elsewhere");
  fs::create_directory(catalogue);
  const auto refused = store_->load(header_.id);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr(catalogue.string()));
  fs::remove(catalogue);
  fs::rename(folder_ / "elsewhere", catalogue);
  serve();
}

TEST_F(StoreChangesTest, AnArchiveWithAnEpochThatNoServerGivesIsDamaged) {
  open();
  keep();
  purge();
  auto file = MapFile::create(archive("odd"), {header_.id, "desk", Epoch{uint64_t{1} << 62}, false, {}},
                              {whole(), {}, {}, {}});
  ASSERT_TRUE(file && file->write_back());
  const auto refused = store_->import_map(archive("odd"));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kDamaged);
  EXPECT_THAT(store_->maps(), IsEmpty());
}

// ---- what is refused

TEST_F(StoreChangesTest, AMapThatCannotBeMovedStaysWithItsLogWhereItWas) {
  open();
  keep();
  ASSERT_TRUE(store_->remove(header_.id));
  for (const char* end : {"-wal", "-shm"})
    std::ofstream(place("deleted").string() + end) << "its last changes";
  fs::create_directories(place("maps").string() + "-shm/taken");  // the file can be moved, this cannot
  const auto before = files();
  const Status refused = store_->undelete(header_.id);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kIo);
  EXPECT_EQ(files(), before);

  fs::remove_all(place("maps").string() + "-shm");
  for (const char* end : {"-wal", "-shm"}) fs::remove(place("deleted").string() + end);
  ASSERT_TRUE(store_->undelete(header_.id));
  store_.reset();
  open();
  fs::remove(folder_ / "deleted");
  std::ofstream(folder_ / "deleted") << "no folder";
  const auto served = files();
  const Status kept = store_->remove(header_.id);
  ASSERT_FALSE(kept);
  EXPECT_THAT(kept.error().message, HasSubstr("Not a directory"));
  EXPECT_EQ(files(), served);
  EXPECT_TRUE(store_->rename(header_.id, "bench")) << "it goes on";
}

TEST_F(StoreChangesTest, AMapThatCannotBePurgedKeepsItsLog) {
  open();
  fs::create_directories(place("deleted") / "taken");  // what stands there cannot be removed
  std::ofstream(place("deleted").string() + "-wal") << "its last changes";
  const auto before = files();
  const Status refused = store_->purge(header_.id);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("Directory not empty"));
  EXPECT_EQ(files(), before);
}

TEST_F(StoreChangesTest, WhatADiskDoesNotTakeIsToldWithTheReasonAndLeavesNothing) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("copy")));
  purge();
  const auto before = files();
  // On the way in: in the first copy, in the making of the file.
  for (const uintmax_t room : {fs::file_size(archive("copy")) / 2, fs::file_size(archive("copy"))}) {
    limit_files(room);
    const auto refused = store_->import_map(archive("copy"));
    limit_files(RLIM_INFINITY);
    ASSERT_FALSE(refused) << room;
    EXPECT_EQ(refused.error().code, ErrorCode::kIo);
    EXPECT_THAT(refused.error().message, HasSubstr("File too large"));
    EXPECT_EQ(files(), before);
  }
  import(archive("copy"));
  serve();
  const fs::path out = folder_ / "transfer" / "export";
  limit_files(fs::file_size(archive("copy")) / 2);
  const Status refused = store_->export_map(header_.id, out);
  limit_files(0);
  const Status unnamed = store_->rename(header_.id, "bench");
  limit_files(RLIM_INFINITY);
  ASSERT_FALSE(refused);
  EXPECT_FALSE(unnamed);
  EXPECT_THAT(refused.error().message, HasSubstr(out.string()));
  fs::remove(out);
  serve();
  EXPECT_EQ(store_->load(header_.id)->header.name, "desk");
}

/// So there is a way out of a full disk.
TEST_F(StoreChangesTest, ADeletedMapIsKnownAndPurgedWhereNothingCanBeWritten) {
  open();
  keep();
  ASSERT_TRUE(store_->remove(header_.id));
  const auto before = files();
  limit_files(0);
  const std::vector<DeletedMap> deleted = store_->deleted_maps();
  ASSERT_EQ(deleted.size(), 1U);
  EXPECT_EQ(deleted[0].header.name, "desk") << deleted[0].problem.value_or(Error{}).message;
  EXPECT_EQ(files(), before);
  EXPECT_TRUE(store_->purge(header_.id));
}

TEST_F(StoreChangesTest, WhatWasTakenInAndCannotBeServedGoesBack) {
  open();
  keep();
  ASSERT_TRUE(store_->export_map(header_.id, archive("copy")));
  ASSERT_TRUE(store_->remove(header_.id));
  const Timestamp deleted = store_->deleted_maps().at(0).deleted;
  ASSERT_TRUE(store_->undelete(header_.id));
  ASSERT_TRUE(store_->undo_undelete(header_.id));
  EXPECT_THAT(store_->maps(), IsEmpty());
  EXPECT_EQ(store_->deleted_maps().at(0).deleted, deleted) << "it is not deleted anew";
  ASSERT_TRUE(store_->purge(header_.id));
  const auto before = files();
  import(archive("copy"));
  ASSERT_TRUE(store_->undo_import(header_.id));
  EXPECT_EQ(files(), before);
}

// ---- what the system says

TEST_F(StoreChangesTest, WhoeverHoldsAFileIsNamed) {
  open();
  keep();
  EXPECT_EQ(holder_of_lock(store_->path_of(header_.id)), "") << "we do not count";
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const int file = ::open(store_->path_of(header_.id).c_str(), O_RDWR);
    struct flock lock {};
    lock.l_type = F_WRLCK;
    const char held = ::fcntl(file, F_SETLK, &lock) == 0 ? 'y' : 'n';
    (void)!::write(ready[1], &held, 1);
    ::pause();
    ::_exit(0);
  }
  char held = 'n';
  ASSERT_EQ(::read(ready[0], &held, 1), 1);
  EXPECT_EQ(held, 'y');
  EXPECT_THAT(holder_of_lock(store_->path_of(header_.id)), HasSubstr("process " + std::to_string(child)));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_EQ(holder_of_lock(store_->path_of(header_.id)), "");
}

TEST_F(StoreChangesTest, WhyAFileCannotBeWrittenIsSaidAsTheSystemSaysIt) {
  EXPECT_EQ(why_not_writable(folder_ / "to be made"), "");
  EXPECT_EQ(why_not_writable(folder_ / "nowhere" / "file"), "No such file or directory");
}

}  // namespace
}  // namespace cairn
