// SPDX-License-Identifier: Apache-2.0
// Keyframes kept aside: they come back as they were, and are no part of the map's state.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "common/image/still_mask.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/proposal_codec.h"
#include "server/store/short_memory.h"
#include "server/store/sqlite.h"
#include "server/store/store.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

class ProposalsTest : public testing::KeptMapFixture {
 protected:
  void SetUp() override {
    start();
    auto store = Store::open(folder_ / "store", null_logger());
    ASSERT_TRUE(store) << store.error().message;
    store_ = std::move(*store);
    ASSERT_TRUE(store_->create(header_, take_update()));
  }
  [[nodiscard]] KeptProposal proposal(uint64_t number) const {
    KeptProposal made;
    ProposalRecord& r = made.record;
    r.summary = {number,
                 "berta",
                 SessionId{9},
                 4,
                 "read only, by default",
                 Timestamp{50},
                 Timestamp{40},
                 Epoch{3},
                 SE3(),
                 1.5,
                 100,
                 61,
                 2000};
    r.reference = KeyframeId{2};
    r.camera_from_reference = SE3(Eigen::Quaterniond::Identity(), {0.1, 0.2, 0.3});
    r.camera = input_.camera->parameters();
    r.measurements = {{PointId{3}, 1, {20, 30}}, {PointId{5}, 0, {25, 31}}};
    r.candidates = {{CandidateId{8}, 2, {40, 50}, 0.5F, 0.1F}};
    r.still_mask.assign(still_mask_bytes(r.camera.width, r.camera.height), 0);
    r.still_mask[0] = 5;
    r.up = UpDirection{Eigen::Vector3d(0, -1, 0), 0.02};
    made.image = {1, 2, 3, 4};
    return made;
  }
  void keep(std::vector<KeptProposal> proposals, std::vector<uint64_t> removed = {}) {
    MapUpdate update;
    update.proposals = std::move(proposals);
    update.removed_proposals = std::move(removed);
    const Status written = store_->write(header_.id, {&update, 1});
    ASSERT_TRUE(written) << written.error().message;
  }
  [[nodiscard]] std::vector<uint64_t> numbers() {
    std::vector<uint64_t> all;
    const auto stored = store_->load(header_.id);
    EXPECT_TRUE(stored);
    EXPECT_THAT(stored->damage, IsEmpty());
    for (const ProposalSummary& p : stored->proposals) all.push_back(p.number);
    return all;
  }
  /// In the map's file, which nobody may have open in the store.
  void alter(const std::string& sql) {
    auto raw = sqlite::Database::open(store_->path_of(header_.id), sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(raw);
    const Status altered = raw->execute(sql);
    ASSERT_TRUE(altered) << altered.error().message;
  }
  [[nodiscard]] int64_t count(const std::string& table) {
    auto raw = sqlite::Database::open(store_->path_of(header_.id), sqlite::OpenMode::kReadWrite);
    return raw ? raw->number("SELECT count(*) FROM " + table + " WHERE id > 0").value_or(-1) : -1;
  }

  std::unique_ptr<Store> store_;
};

TEST_F(ProposalsTest, WhatIsReadIsWhatWasKept) {
  const KeptProposal kept = proposal(7);
  keep({kept});
  const auto read = store_->read_proposal(header_.id, 7);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->image, kept.image);
  EXPECT_EQ(encode_proposal(read->record), encode_proposal(kept.record));
  EXPECT_EQ(read->record.summary.client, "berta");
  EXPECT_EQ(read->record.summary.number, 7U);
  EXPECT_EQ(read->record.measurements[1].id, (PointId{5}));
  EXPECT_FALSE(store_->read_proposal(header_.id, 8));
}

TEST_F(ProposalsTest, ANumberDoesNotComeAgain) {
  keep({proposal(1), proposal(2), proposal(3)});
  keep({}, {3, 1});
  EXPECT_THAT(numbers(), ElementsAre(2));
  EXPECT_EQ(store_->load(header_.id)->last_proposal, 3U);
  EXPECT_FALSE(store_->read_proposal(header_.id, 3));
}

TEST_F(ProposalsTest, RollBackLeavesThemAlone) {
  keep({proposal(1)});
  ASSERT_TRUE(store_->tag(header_.id, {0, "bare", Timestamp{7}, "operator ann", 0, 0, 0, 0}));
  keep({proposal(2)}, {1});
  store_->close(header_.id);
  ASSERT_TRUE(store_->roll_back(header_.id, "bare", {0, "", Timestamp{8}, "operator ann", 0, 0, 0, 0}, {}));
  EXPECT_THAT(numbers(), ElementsAre(2));
}

TEST_F(ProposalsTest, TheyGoWithADeletedMapAndComeBackWithIt) {
  keep({proposal(1)});
  ASSERT_TRUE(store_->remove(header_.id));
  ASSERT_TRUE(store_->undelete(header_.id));
  EXPECT_THAT(numbers(), ElementsAre(1));
}

TEST_F(ProposalsTest, AnArchiveAndACopyHaveNone) {
  KeptProposal kept = proposal(1);
  kept.image.clear();
  const std::string shown = "what the image of a stranger shows";
  for (int i = 0; i < 1000; ++i) kept.image.insert(kept.image.end(), shown.begin(), shown.end());
  keep({kept});
  const auto archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store_->export_map(header_.id, archive));
  const auto read = read_archive(archive);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->proposals, IsEmpty());
  std::ifstream in(archive, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  EXPECT_EQ(bytes.find(shown), std::string::npos) << "it can still be read in the archive";
  const MapId copy{{7, 2}};
  ASSERT_TRUE(store_->copy_map(header_.id, copy, "copy"));
  EXPECT_THAT(store_->load(copy)->proposals, IsEmpty());
  EXPECT_THAT(numbers(), ElementsAre(1));
}

TEST_F(ProposalsTest, ADamagedOneIsNamedAndTheMapIsWhole) {
  keep({proposal(1), proposal(2)});
  const auto path = store_->path_of(header_.id);
  store_.reset();
  {
    auto raw = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(raw && raw->execute("UPDATE proposals SET data = x'00' WHERE id = 1"));
  }
  auto file = MapFile::open(path);
  ASSERT_TRUE(file);
  const StoredMap stored = file->load();
  EXPECT_THAT(stored.damage, IsEmpty());
  EXPECT_THAT(stored.lost_proposals, ElementsAre(HasSubstr("table proposals, row 1")));
  EXPECT_THAT(stored.proposals, SizeIs(1));
  EXPECT_EQ(stored.record.keyframe_count, 2U);
}

TEST_F(ProposalsTest, ADamagedOneKeepsNothingFromWorkingAndGoesWithTheNextStart) {
  ASSERT_TRUE(store_->tag(header_.id, {0, "bare", Timestamp{7}, "operator ann", 0, 0, 0, 0}));
  keep({proposal(1), proposal(2), proposal(3)});
  const auto path = store_->path_of(header_.id);
  const std::string part = "maps/" + path.filename().string();
  store_.reset();
  {
    auto raw = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(raw && raw->execute("UPDATE proposals SET data = x'00' WHERE id IN (0, 3);"
                                    "UPDATE proposal_pictures SET data = x'00' WHERE id = 2"));
  }
  store_ = std::move(*Store::open(folder_ / "store", null_logger()));
  FileCheck check = check_part(folder_ / "store", part, {});
  EXPECT_THAT(check.faults, IsEmpty());
  EXPECT_THAT(check.lost_proposals,
              ElementsAre(HasSubstr("table proposals, row 0"), HasSubstr("table proposals, row 3"),
                          HasSubstr("table proposal_pictures, row 1"), HasSubstr("proposal_pictures, row 2")))
      << "and the image of 1 is none";
  EXPECT_THAT(check.remedy, HasSubstr("the map is whole"));
  size_t shown = 0;
  const Status rolled_back = store_->roll_back(header_.id, "bare", {0, "", Timestamp{8}, "ann", 0, 0, 0, 0},
                                               [&shown](const StoredMap& state) {
                                                 EXPECT_THAT(state.damage, IsEmpty());
                                                 shown = state.proposals.size();
                                                 return Status();
                                               });
  ASSERT_TRUE(rolled_back) << rolled_back.error().message;
  EXPECT_EQ(shown, 2U);
  EXPECT_TRUE(store_->copy_map(header_.id, MapId{{7, 2}}, "copy"));

  const auto stored = store_->load(header_.id);
  ASSERT_TRUE(stored);
  EXPECT_THAT(stored->damage, IsEmpty());
  EXPECT_EQ(stored->last_proposal, 3U);
  EXPECT_THAT(numbers(), ElementsAre(1, 2));
  check = check_part(folder_ / "store", part, {});
  EXPECT_THAT(check.lost_proposals, SizeIs(2)) << "the images: those can be dropped";
  keep({}, {1, 2});
  check = check_part(folder_ / "store", part, {});
  EXPECT_THAT(check.lost_proposals, IsEmpty());
  EXPECT_EQ(store_->load(header_.id)->last_proposal, 3U) << "no number comes again";
}

TEST_F(ProposalsTest, WhereTheTableCannotBeReadToItsEndNoneOfThemIsForgotten) {
  keep({proposal(1), proposal(2), proposal(3), proposal(4)});
  store_->close(header_.id);
  const std::string large = std::to_string(testing::ShortMemory::kTooLarge);
  alter("UPDATE proposals SET data = zeroblob(" + large + ") WHERE id = 2");
  {
    const testing::ShortMemory short_memory;
    const auto stored = store_->load(header_.id);
    ASSERT_TRUE(stored) << stored.error().message;
    EXPECT_THAT(stored->damage, ElementsAre(HasSubstr("table proposals")));
    EXPECT_THAT(stored->lost_proposals, IsEmpty()) << "none was read and found unfit";
  }
  EXPECT_EQ(count("proposals"), 4);
  EXPECT_EQ(count("proposal_pictures"), 4);
  EXPECT_THAT(numbers(), ElementsAre(1, 3, 4)) << "the second was read now, and is none";
  EXPECT_EQ(count("proposals"), 3) << "only the row that was unfit itself has gone";
  EXPECT_EQ(count("proposal_pictures"), 3);
}

TEST_F(ProposalsTest, ADamagedFileIsNotWrittenToForADamagedProposal) {
  keep({proposal(1), proposal(2)});
  store_->close(header_.id);
  alter(
      "UPDATE proposals SET data = x'00' WHERE id = 1;"
      "UPDATE positions SET checksum = checksum + 1 WHERE id = 1");
  const auto stored = store_->load(header_.id);
  ASSERT_TRUE(stored) << stored.error().message;
  EXPECT_THAT(stored->damage, ElementsAre(HasSubstr("table positions, row 1")));
  EXPECT_THAT(stored->lost_proposals, SizeIs(1));
  EXPECT_EQ(count("proposals"), 2) << "it is what is kept of the file as it was found";
  EXPECT_EQ(count("proposal_pictures"), 2);
}

TEST_F(ProposalsTest, ANumberOfAnArchiveThatLeavesNoRoomForMoreIsNotBelieved) {
  const auto archive = folder_ / "desk.cairnmap";
  for (const uint64_t last : {kMostProposalNumber / 2, kMostProposalNumber / 2 + 1, kMostProposalNumber}) {
    SCOPED_TRACE(std::to_string(last));
    MapUpdate update;
    update.last_proposal = last;
    ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
    ASSERT_TRUE(store_->export_map(header_.id, archive));
    ASSERT_TRUE(store_->remove(header_.id));
    ASSERT_TRUE(store_->purge(header_.id));
    const auto back = store_->import_map(archive);
    ASSERT_TRUE(back) << back.error().message;
    const auto stored = store_->load(header_.id);
    ASSERT_TRUE(stored) << stored.error().message;
    EXPECT_EQ(stored->last_proposal, last <= kMostProposalNumber / 2 ? last : 0);
    keep({proposal(stored->last_proposal + 1)});
    EXPECT_THAT(store_->load(header_.id)->lost_proposals, IsEmpty()) << "the number that follows is fit";
    keep({}, {stored->last_proposal + 1});
    std::filesystem::remove(archive);
  }
}

TEST_F(ProposalsTest, WhatADeletedMapLostIsSaidWithWhatCanBeDoneThere) {
  keep({proposal(1)});
  ASSERT_TRUE(store_->remove(header_.id));
  const std::string part = "deleted/" + to_hex(header_.id.bytes) + ".cairnmap";
  const FileCheck check = check_part(folder_ / "store", part, {});
  EXPECT_THAT(check.faults, IsEmpty());
  EXPECT_THAT(check.lost_proposals, SizeIs(1)) << "the image of the fixture is none";
  EXPECT_THAT(check.remedy, HasSubstr("maps purge"));
  EXPECT_THAT(check.remedy, Not(HasSubstr("proposals drop"))) << "that knows the maps that are served";
}

TEST_F(ProposalsTest, NoNumberComesAgainWhereAnArchiveOfTheMapIsTakenInAgain) {
  keep({proposal(1), proposal(4)});
  const auto archive = folder_ / "desk.cairnmap";
  ASSERT_TRUE(store_->export_map(header_.id, archive));
  ASSERT_TRUE(store_->remove(header_.id));
  ASSERT_TRUE(store_->purge(header_.id));
  const auto back = store_->import_map(archive);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(store_->load(header_.id)->last_proposal, 4U);
}

TEST_F(ProposalsTest, NoBytesDoHarm) {
  const Blob whole = encode_proposal(proposal(3).record);
  ASSERT_TRUE(decode_proposal(3, whole));
  EXPECT_FALSE(decode_proposal(0, whole));
  for (size_t size = 0; size < whole.size(); ++size) {
    const Blob part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    // It may end where its mask begins: most have none.
    const auto decoded = decode_proposal(3, part);
    EXPECT_TRUE(!decoded || encode_proposal(*decoded) == part);
  }
  for (size_t at = 0; at < whole.size(); ++at) {
    Blob other = whole;
    other[at] ^= 0xFF;
    (void)decode_proposal(3, other);
  }
}

}  // namespace
}  // namespace cairn
