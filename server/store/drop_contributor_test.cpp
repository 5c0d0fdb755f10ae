// SPDX-License-Identifier: Apache-2.0
#include "server/store/drop_contributor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <memory>
#include <sstream>

#include "server/mapping/map_maker.h"
#include "server/store/epochs.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/short_memory.h"
#include "server/store/sqlite.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

class DropContributor : public testing::KeptMapFixture {
 protected:
  /// Anna begins the map; bob and carl offer keyframes.
  void keep() {
    store_ = *Store::open(folder_ / "store", null_logger());
    start();
    MapUpdate whole = take_update();
    DecisionRecord seed = decision_of("anna", KeyframeId{2});
    seed.kind = CommandKind::kSeed;
    whole.decisions = {seed};
    ASSERT_TRUE(store_->create(header_, whole));
    grow("bob", 5);
    grow("carl", 8);
    grow("bob", 11);
  }
  static DecisionRecord decision_of(const std::string& client, KeyframeId keyframe) {
    DecisionRecord made = decision(keyframe.value);
    made.client = client;
    made.keyframe = keyframe;
    return made;
  }
  void grow(const std::string& client, int step) {
    const KeyframeDecision accepted = offer(step);
    ASSERT_EQ(accepted.verdict, KeyframeVerdict::kAccepted) << accepted.reason;
    adjust_globally();
    MapUpdate update = take_update();
    update.decisions = {decision_of(client, accepted.keyframe)};
    const SE3 seen(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 1));
    update.labels = {{accepted.keyframe.value, client, SE3(), client, Timestamp{5}, LabelKind::kText,
                      accepted.keyframe, seen}};
    ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  }
  [[nodiscard]] Status drop(const std::string& client, const AcceptState& accept = {}) {
    store_->close(header_.id);
    return drop_contributor(store_.get(), header_.id, client, accept);
  }
  [[nodiscard]] std::vector<std::string> contributors() {
    std::vector<std::string> names;
    const auto known = store_->contributions(header_.id);
    EXPECT_TRUE(known);
    for (const auto& [keyframe, client] : known.value_or(std::vector<Contribution>()))
      names.push_back(std::to_string(keyframe.value) + " " + client);
    return names;
  }
  /// Of a frame like that of step 8, with the points of keyframe 4.
  [[nodiscard]] KeptProposal proposal(uint64_t number, const std::string& client, KeyframeId reference,
                                      const StoredMap& map) {
    const auto seen =
        std::ranges::find(map.record.measurements, KeyframeId{4}, &MeasurementsRecord::keyframe);
    const SE3& pose = map.record.keyframes[3].camera_from_map;
    KeptProposal made;
    ProposalRecord& r = made.record;
    r.summary.number = number;
    r.summary.client = client;
    r.summary.epoch = map.header.epoch;
    r.summary.camera_from_map = pose;
    r.summary.mean_depth = 1;
    r.reference = reference;
    r.camera_from_reference = pose * map.record.keyframes[reference.value - 1].camera_from_map.inverse();
    r.camera = input_.camera->parameters();
    for (const Measurement& m : seen->measurements)
      r.measurements.push_back({m.point, m.level, m.pixel.cast<float>()});
    made.image = encode_image_row(*scene_.view(8));
    return made;
  }
  void expect_sound(size_t keyframes) {
    const auto check = check_part(folder_ / "store", "maps/" + to_hex(header_.id.bytes) + ".cairnmap", {});
    EXPECT_THAT(check.faults, IsEmpty());
    EXPECT_EQ(check.keyframes, keyframes);
    EXPECT_EQ(check.tags, 0U) << "they would bring back what has gone";
  }

  std::unique_ptr<Store> store_;
};

TEST_F(DropContributor, TheRestIsAMapThatGoesOnAndKnowsNothingOfHim) {
  keep();
  EXPECT_THAT(contributors(), ElementsAre("1 anna", "2 anna", "3 bob", "4 carl", "5 bob"));
  ASSERT_TRUE(store_->tag(header_.id, {0, "monday", {}, "ann", 5, 9, 0, 0}));
  const StoredMap before = *store_->load(header_.id);
  const SE3 bobs = before.record.keyframes[2].camera_from_map.inverse() * before.labels[0].anchor_from_label;
  const Status dropped = drop("bob");
  ASSERT_TRUE(dropped) << dropped.error().message;
  EXPECT_THAT(contributors(), ElementsAre("1 anna", "2 anna", "3 carl"));
  expect_sound(3);

  const StoredMap after = *store_->load(header_.id);
  EXPECT_THAT(after.damage, IsEmpty());
  EXPECT_THAT(after.record.images, SizeIs(3));
  EXPECT_THAT(after.decisions, SizeIs(2));
  for (const EpochRecord& epoch : after.epochs) EXPECT_GT(epoch.epoch, before.header.epoch);
  ASSERT_THAT(after.labels, SizeIs(3)) << "what he said of places stays";
  EXPECT_FALSE(after.labels[0].anchor);
  EXPECT_LT((after.labels[0].map_from_label.translation() - bobs.translation()).norm(), 1e-9);
  EXPECT_EQ(after.labels[1].anchor, KeyframeId{3}) << "carl's, as it is called now";

  auto restored = MapMaker::restore(after.record, {header_.id, "desk", after.header.epoch}, options_);
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_THAT(restored->repairs, IsEmpty());
  maker_ = std::move(restored->maker);
  EXPECT_EQ(offer(11).verdict, KeyframeVerdict::kAccepted);
}

TEST_F(DropContributor, OnlyHisProposalsGoAndNoNumberComesAgain) {
  keep();
  const StoredMap before = *store_->load(header_.id);
  MapUpdate update;
  update.proposals = {proposal(1, "carl", KeyframeId{4}, before), proposal(2, "bob", KeyframeId{4}, before),
                      proposal(3, "carl", KeyframeId{5}, before), proposal(4, "bob", KeyframeId{4}, before)};
  ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  ASSERT_TRUE(drop("bob"));
  const StoredMap after = *store_->load(header_.id);
  EXPECT_EQ(after.last_proposal, 4U);
  ASSERT_THAT(after.proposals, SizeIs(2));
  for (const ProposalSummary& told : after.proposals) {
    SCOPED_TRACE(std::to_string(told.number));
    EXPECT_EQ(told.client, "carl");
    const auto kept = store_->read_proposal(header_.id, told.number);
    ASSERT_TRUE(kept) << kept.error().message;
    const ProposalRecord& r = kept->record;
    const auto same = ids_in_common(after.epochs, told.epoch, after.header.epoch);
    ASSERT_TRUE(same) << "it can be accepted still";
    ASSERT_LE(r.reference.value, after.record.keyframes.size());
    const SE3 pose = r.camera_from_reference * after.record.keyframes[r.reference.value - 1].camera_from_map;
    EXPECT_LT((pose.center() - told.camera_from_map.center()).norm(), 1e-6);
    EXPECT_EQ(r.reference, KeyframeId{3}) << "carl's, the nearest, as it is called now";
    const auto seen =
        std::ranges::find(after.record.measurements, KeyframeId{3}, &MeasurementsRecord::keyframe);
    ASSERT_EQ(r.measurements.size(), seen->measurements.size());
    for (size_t i = 0; i < r.measurements.size(); ++i)
      EXPECT_EQ(r.measurements[i].id, seen->measurements[i].point);
  }
  expect_sound(3);
  update = {};
  update.removed_proposals = {1, 3};
  ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  EXPECT_EQ(store_->load(header_.id)->last_proposal, 4U);
}

TEST_F(DropContributor, AProposalThatCannotBeReadForNowIsNotLostAndADamagedOneIsNamed) {
  keep();
  const StoredMap before = *store_->load(header_.id);
  MapUpdate update;
  update.proposals = {proposal(1, "carl", KeyframeId{4}, before), proposal(2, "carl", KeyframeId{4}, before)};
  ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  store_.reset();
  const auto path = folder_ / "store/maps" / (to_hex(header_.id.bytes) + ".cairnmap");
  {
    auto raw = sqlite::Database::open(path, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(raw && raw->execute("UPDATE proposal_pictures SET data = zeroblob(" +
                                    std::to_string(testing::ShortMemory::kTooLarge) + ") WHERE id = 2"));
  }
  std::ostringstream said;
  auto log =
      std::make_shared<spdlog::logger>("store", std::make_shared<spdlog::sinks::ostream_sink_st>(said));
  store_ = *Store::open(folder_ / "store", log);
  {
    const testing::ShortMemory short_memory;
    const Status dropped = drop("bob");
    ASSERT_FALSE(dropped) << "the proposal would be gone for good";
    EXPECT_EQ(dropped.error().code, ErrorCode::kIo);
  }
  EXPECT_THAT(store_->load(header_.id)->proposals, SizeIs(2));
  EXPECT_THAT(contributors(), SizeIs(5));
  EXPECT_THAT(said.str(), Not(HasSubstr("is lost")));

  ASSERT_TRUE(drop("bob")) << "now it is read, and is damaged: its checksum is of another image";
  EXPECT_THAT(store_->load(header_.id)->proposals, SizeIs(1));
  EXPECT_THAT(said.str(),
              HasSubstr("table proposal_pictures, row 2: the checksum is wrong; the proposal is lost"));
}

TEST_F(DropContributor, WhatIsNotAcceptedHasNotHappened) {
  keep();
  ASSERT_TRUE(store_->tag(header_.id, {0, "monday", {}, "ann", 5, 9, 0, 0}));
  size_t shown = 0;
  const Status refused = drop("bob", [&shown](const StoredMap& state) {
    shown = state.record.keyframes.size();
    return fail(ErrorCode::kRefused, "no room");
  });
  ASSERT_FALSE(refused);
  EXPECT_EQ(shown, 3U);
  EXPECT_THAT(contributors(), SizeIs(5));
  EXPECT_THAT(*store_->tags(header_.id), SizeIs(1));
  const std::filesystem::path maps = folder_ / "store/maps";
  for (const auto& entry : std::filesystem::directory_iterator(maps))
    EXPECT_THAT(entry.path().filename().string(), HasSubstr(".cairnmap")) << "nothing is left of it";
}

TEST_F(DropContributor, WhoBeganTheMapCanGoAndNobodyTakesAllOfIt) {
  keep();
  ASSERT_TRUE(drop("anna"));
  EXPECT_THAT(contributors(), ElementsAre("1 bob", "2 carl", "3 bob"));
  expect_sound(3);
  const Status all = drop("bob");
  ASSERT_FALSE(all);
  EXPECT_EQ(all.error().code, ErrorCode::kRefused);
  EXPECT_THAT(all.error().message, HasSubstr("nothing would be left of map desk"));
  const Status nobody = drop("dora");
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().code, ErrorCode::kNotFound);
  expect_sound(3);
}

}  // namespace
}  // namespace cairn
