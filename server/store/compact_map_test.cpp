// SPDX-License-Identifier: Apache-2.0
#include "server/store/compact_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>

#include "server/mapping/map_maker.h"
#include "server/store/entry_codec.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/proposal_codec.h"
#include "server/store/sqlite.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

/// A map in a store, of which more and more is removed.
class CompactMap : public testing::KeptMapFixture {
 protected:
  void keep() {
    store_ = *Store::open(folder_ / "store", null_logger());
    start();
    for (const int step : {5, 8, 11}) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    adjust_globally();
    MapUpdate whole = take_update();
    for (uint64_t id = 3; id <= 5; ++id) whole.decisions.push_back(decision_on(id));
    whole.labels = {{1, "kettle", SE3(), "anna", Timestamp{5}, LabelKind::kText, KeyframeId{4},
                     SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 1))}};
    ASSERT_TRUE(store_->create(header_, whole));
  }
  /// Decisions of each kind, by others; what was removed of labels and proposals; proposals that wait.
  void keep_more() {
    const StoredMap map = load();
    MapUpdate update;
    DecisionRecord seed = decision_on(2);
    seed.kind = CommandKind::kSeed;
    seed.session = SessionId{41};
    for (uint64_t id = 1; id <= map.record.point_count; ++id)
      seed.seed_points.emplace_back(TrailId{id + 500}, PointId{id});
    DecisionRecord bobs = decision_on(4);
    bobs.client = "bob";
    DecisionRecord carls = decision_on(5);
    carls.client = "carl";
    DecisionRecord refused = decision(9);
    refused.decision = 3;
    refused.time = Timestamp{123};
    DecisionRecord labelled = decision(2);
    labelled.kind = CommandKind::kRequest;
    labelled.label = 8;
    update.decisions = {seed, bobs, carls, refused, labelled};
    update.labels = {{7, "loose", SE3(), "bob", Timestamp{6}, LabelKind::kModel},
                     {8, "gone", SE3(), "bob", Timestamp{7}, LabelKind::kText}};
    for (const uint64_t number : {4, 9, 12}) update.proposals.push_back(proposal(number, map));
    MapUpdate removed;
    removed.removed_labels = {8};
    removed.removed_proposals = {12};
    for (const MapUpdate& one : {update, removed}) ASSERT_TRUE(store_->write(header_.id, {&one, 1}));
  }
  [[nodiscard]] KeptProposal proposal(uint64_t number, const StoredMap& map) const {
    KeptProposal made;
    ProposalRecord& r = made.record;
    r.summary.number = number;
    r.summary.client = "dora";
    r.summary.session = SessionId{6};
    r.summary.seq = number;
    r.summary.why = "read only";
    r.summary.epoch = map.header.epoch;
    r.summary.mean_depth = 1;
    r.summary.expected = 40;
    r.summary.found = 30;
    r.reference = KeyframeId{4};
    r.camera_from_reference = SE3(Eigen::Quaterniond::Identity(), {0.1, 0.2, 0.3});
    r.camera = input_.camera->parameters();
    for (const auto& seen : map.record.measurements) {
      if (seen.keyframe != KeyframeId{1}) continue;
      for (const Measurement& m : seen.measurements) r.measurements.push_back({m.point, m.level, m.pixel});
    }
    made.image = {1, 2, static_cast<uint8_t>(number)};
    return made;
  }
  [[nodiscard]] std::map<std::string, int64_t> rows_of_tables() const {
    std::map<std::string, int64_t> rows;
    auto file = *sqlite::Database::open(store_->path_of(header_.id), sqlite::OpenMode::kReadWrite);
    auto tables = *file.prepare("SELECT name FROM sqlite_master WHERE type = 'table'");
    while (*tables.step()) rows[tables.text(0)] = *file.number("SELECT count(*) FROM " + tables.text(0));
    return rows;
  }
  static DecisionRecord decision_on(uint64_t keyframe) {
    DecisionRecord made = decision(keyframe);
    made.keyframe = KeyframeId{keyframe};
    return made;
  }
  [[nodiscard]] StoredMap load() {
    auto loaded = store_->load(header_.id);
    EXPECT_TRUE(loaded) << loaded.error().message;
    StoredMap map = loaded ? std::move(*loaded) : StoredMap();
    EXPECT_THAT(map.damage, IsEmpty());
    return map;
  }
  /// As upkeep does: written as what has changed since the map was loaded.
  void remove(const std::function<void(MapState* state)>& what) {
    const StoredMap map = load();
    MapState state = assemble_map(map.record, RestoredImages::kStay)->state;
    MapRecorder recorder;
    (void)recorder.take(state, *map.record.foundation, *map.record.work);
    what(&state);
    const MapUpdate update{recorder.take(state, *map.record.foundation, *map.record.work), {}, {}, {}};
    ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  }
  [[nodiscard]] Status compact() {
    store_->close(header_.id);
    return compact_map(store_.get(), header_.id);
  }
  /// What a replica has of a map, whatever the ids: positions of points, poses of keyframes.
  [[nodiscard]] static std::vector<std::vector<float>> seen_of(const MapSnapshot& map) {
    std::vector<std::vector<float>> seen;
    for (const auto& block : map.point_blocks) {
      for (int slot = 0; slot < block->count; ++slot) {
        if (!map.find(block->source(slot).id)) continue;
        const auto at = block->position(slot);
        seen.push_back({static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z())});
      }
    }
    for (const auto& block : map.keyframe_blocks) {
      for (const KeyframePose& k : block->keyframes) {
        if (map.find(k.id) == nullptr) continue;
        const Eigen::Vector3f at = k.camera_from_map.center().cast<float>();
        seen.push_back({at.x(), at.y(), at.z(), 1});
      }
    }
    std::ranges::sort(seen);
    return seen;
  }
  [[nodiscard]] MapSnapshotPtr served(const StoredMap& map) {
    auto restored = MapMaker::restore(map.record, {header_.id, header_.name, map.header.epoch}, options_);
    EXPECT_TRUE(restored) << restored.error().message;
    EXPECT_THAT(restored->repairs, IsEmpty());
    return restored->maker->snapshot();
  }

  std::unique_ptr<Store> store_;
};

TEST_F(CompactMap, AllThatLivesGoesOnUnderOtherIds) {
  keep();
  remove([](MapState* state) { state->remove_keyframe(KeyframeId{3}); });
  const StoredMap before = load();
  const auto label_at = [](const StoredMap& map) {
    const KeyframeRecord& anchor = map.record.keyframes[map.labels[0].anchor.value - 1];
    return (anchor.camera_from_map.inverse() * map.labels[0].anchor_from_label).translation();
  };
  const MapSnapshotPtr was = served(before);
  ASSERT_TRUE(compact());
  const StoredMap after = load();
  const MapSnapshotPtr is = served(after);
  EXPECT_EQ(seen_of(*is), seen_of(*was));
  EXPECT_GT(after.header.epoch, before.header.epoch);
  EXPECT_EQ(after.record.keyframe_count, 4U);
  EXPECT_EQ(after.record.point_count, is->point_count()) << "no place is taken by what was removed";
  EXPECT_LT(after.record.point_count, before.record.point_count);
  EXPECT_THAT(after.record.images, SizeIs(4));
  ASSERT_THAT(after.decisions, SizeIs(3)) << "what was decided stays decided";
  EXPECT_FALSE(after.decisions[0].keyframe) << "it has gone";
  EXPECT_EQ(after.decisions[1].keyframe, KeyframeId{3});
  EXPECT_EQ(after.decisions[2].keyframe, KeyframeId{4});
  ASSERT_THAT(after.labels, SizeIs(1));
  EXPECT_LT((label_at(after) - label_at(before)).norm(), 1e-9);
  for (const EpochRecord& epoch : after.epochs)
    EXPECT_GT(epoch.epoch, before.header.epoch) << "no id of before is understood";
}

/// Of a table that is added one day, too.
TEST_F(CompactMap, NothingElseOfTheFileIsLostOrChanged) {
  header_.metric = true;
  header_.created = Timestamp{77};
  keep();
  keep_more();
  remove([](MapState* state) { state->remove_keyframe(KeyframeId{3}); });
  store_->close(header_.id);
  const StoredMap before = load();
  const auto rows_before = rows_of_tables();
  MapState state = assemble_map(before.record, RestoredImages::kStay)->state;
  const Renumbering now = state.compact();
  std::vector<KeptProposal> proposed;
  for (const uint64_t number : {4, 9}) {
    const auto kept = store_->read_proposal(header_.id, number);
    ASSERT_TRUE(kept) << kept.error().message;
    proposed.push_back(*kept);
  }
  ASSERT_TRUE(compact());
  const StoredMap after = load();

  EXPECT_EQ(after.header.id, before.header.id);
  EXPECT_EQ(after.header.name, before.header.name);
  EXPECT_TRUE(after.header.metric);
  EXPECT_EQ(after.header.created, before.header.created);
  EXPECT_EQ(encode_foundation(*after.record.foundation), encode_foundation(*before.record.foundation));
  WorkRecord work = *before.record.work;
  work.newest = now.of(work.newest);
  EXPECT_EQ(encode_work(*after.record.work), encode_work(work));
  ASSERT_THAT(after.decisions, SizeIs(before.decisions.size()));
  for (size_t i = 0; i < before.decisions.size(); ++i) {
    DecisionRecord expected = before.decisions[i];
    expected.keyframe = now.of(expected.keyframe);
    for (auto& [trail, point] : expected.seed_points) point = now.of(point);
    std::erase_if(expected.seed_points, [](const auto& of_trail) { return !of_trail.second; });
    EXPECT_EQ(encode_decision(after.decisions[i]), encode_decision(expected)) << i;
  }
  EXPECT_THAT(after.decisions[3].seed_points, Not(IsEmpty()));
  EXPECT_THAT(after.contributions,
              ElementsAre(Contribution{KeyframeId{1}, "anna"}, Contribution{KeyframeId{2}, "anna"},
                          Contribution{KeyframeId{3}, "bob"}, Contribution{KeyframeId{4}, "carl"}));
  ASSERT_THAT(after.labels, SizeIs(before.labels.size()));
  for (size_t i = 0; i < before.labels.size(); ++i) {
    LabelRecord expected = before.labels[i];
    expected.anchor = now.of(expected.anchor);
    expected.map_from_label = after.labels[i].map_from_label;  // where its keyframe is by now
    EXPECT_EQ(encode_label(after.labels[i]), encode_label(expected)) << i;
  }
  EXPECT_EQ(after.last_proposal, 12U) << "its number does not come again";
  for (KeptProposal& expected : proposed) {
    const auto kept = store_->read_proposal(header_.id, expected.record.summary.number);
    ASSERT_TRUE(kept) << kept.error().message;
    EXPECT_EQ(kept->image, expected.image);
    EXPECT_GT(kept->record.summary.epoch, expected.record.summary.epoch);
    expected.record.summary.epoch = kept->record.summary.epoch;
    expected.record.reference = now.of(expected.record.reference);
    std::erase_if(expected.record.measurements, [&](PointMeasurement& m) {
      m.id = now.of(m.id);
      return !m.id;
    });
    EXPECT_EQ(encode_proposal(kept->record), encode_proposal(expected.record));
  }
  auto rows_expected = rows_before;
  for (const char* table : {"keyframes", "measurements", "contributors"}) --rows_expected[table];
  for (const char* table : {"sources", "positions"})
    rows_expected[table] = static_cast<int64_t>(block_count(after.record.point_count));
  rows_expected["epochs"] = static_cast<int64_t>(after.epochs.size());  // those before are over
  EXPECT_EQ(rows_of_tables(), rows_expected);
}

TEST_F(CompactMap, WorkThatWasDueStaysDue) {
  keep();
  const KeyframeDecision last = maker_->add_keyframe(make_offer(scene_, *maker_->snapshot(), 14));
  ASSERT_EQ(last.verdict, KeyframeVerdict::kAccepted) << last.reason;
  const MapUpdate update = take_update();
  ASSERT_TRUE(store_->write(header_.id, {&update, 1}));
  remove([](MapState* state) { state->remove_keyframe(KeyframeId{3}); });
  ASSERT_TRUE(compact());
  const StoredMap after = load();
  ASSERT_TRUE(after.record.work);
  ASSERT_THAT(after.record.work->wanting_points, SizeIs(1));
  EXPECT_EQ(after.record.work->wanting_points[0].id.value, last.keyframe.value - 1);
  auto restored = MapMaker::restore(after.record, {header_.id, header_.name, after.header.epoch}, options_);
  ASSERT_TRUE(restored);
  const size_t points = restored->maker->snapshot()->point_count();
  while (restored->maker->step(testing::kNeverYield).work != MapWork::kNone) {
  }
  EXPECT_GT(restored->maker->snapshot()->point_count(), points);
}

TEST_F(CompactMap, AMapWithTagsStaysAsItIs) {
  keep();
  ASSERT_TRUE(store_->tag(header_.id, {0, "monday", {}, "ann", 5, 9, 0, 0}));
  const Status refused = compact();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
  EXPECT_THAT(refused.error().message, HasSubstr("it has tags"));
  EXPECT_THAT(*store_->tags(header_.id), SizeIs(1));
}

/// A year in short: points come and go, epoch by epoch, and the file takes no more room than what lives.
TEST_F(CompactMap, ThroughManyLivesTheMapStaysSoundAndNoEpochComesAgain) {
  constexpr unsigned kSeedOfLives = 3;
  std::mt19937 random(kSeedOfLives);
  keep();
  Epoch last = load().header.epoch;
  size_t removed = 0;
  for (int life = 0; life < 12; ++life) {
    remove([&](MapState* state) {
      for (size_t i = 0; i < 10; ++i, ++removed)
        state->remove_point(state->live_point_ids()[random() % state->live_points()]);
    });
    const MapSnapshotPtr was = served(load());
    ASSERT_TRUE(compact()) << "seed " << kSeedOfLives << ", life " << life;
    const StoredMap map = load();
    ASSERT_GT(map.header.epoch, last);
    last = map.header.epoch;
    const MapSnapshotPtr is = served(map);
    ASSERT_EQ(seen_of(*is), seen_of(*was)) << "seed " << kSeedOfLives << ", life " << life;
    ASSERT_EQ(map.record.point_count, is->point_count());
  }
  EXPECT_EQ(removed, 120U);
  const auto check = check_part(folder_ / "store", "maps/" + to_hex(header_.id.bytes) + ".cairnmap", {});
  EXPECT_THAT(check.faults, IsEmpty());
  EXPECT_EQ(check.keyframes, 5U);
}

}  // namespace
}  // namespace cairn
