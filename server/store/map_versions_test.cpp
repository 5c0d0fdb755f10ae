// SPDX-License-Identifier: Apache-2.0
// Tags of a map: what was tagged comes back as it was, whatever happened since.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/mapping/map_maker.h"
#include "server/store/kept_map_fixture.h"
#include "server/store/sqlite.h"
#include "server/store/store.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class MapVersionsTest : public testing::KeptMapFixture {
 protected:
  /// What a tag has to bring back.
  struct State {
    std::vector<uint8_t> map;
    std::vector<std::string> labels;
    size_t keyframes = 0;
  };

  void keep() {
    start();
    auto file = MapFile::create(path_, header_, take_update());
    ASSERT_TRUE(file) << file.error().message;
    file_.emplace(std::move(*file));
  }
  /// A keyframe and a label more, adjusted.
  void grow(int step, uint64_t label, const std::string& text) {
    const KeyframeDecision accepted = offer(step);
    ASSERT_EQ(accepted.verdict, KeyframeVerdict::kAccepted) << accepted.reason;
    adjust_globally();
    MapUpdate update = take_update();
    update.decisions = {decision(static_cast<uint64_t>(step))};
    update.decisions[0].keyframe = accepted.keyframe;
    update.labels = {{label, text, SE3(), "anna", Timestamp{5}}};
    const Status written = file_->write({&update, 1});
    ASSERT_TRUE(written) << written.error().message;
  }
  /// The map maker goes on from what the file says.
  void take_up() {
    const StoredMap stored = file_->load();
    ASSERT_THAT(stored.damage, IsEmpty());
    auto restored =
        MapMaker::restore(stored.record, {header_.id, header_.name, stored.header.epoch}, options_);
    ASSERT_TRUE(restored) << restored.error().message;
    ASSERT_THAT(restored->repairs, IsEmpty());
    maker_ = std::move(restored->maker);
    (void)maker_->take_changes();
  }
  [[nodiscard]] Status tag(const std::string& name) {
    return file_->tag({0, name, Timestamp{7}, "operator ann", 0, 0, 0, 0});
  }
  /// What there is before it is tagged undo-1, undo-2, ...
  [[nodiscard]] Status roll_back(const std::string& name, const AcceptState& accept = {}) {
    const Epoch epoch{file_->header().epoch.value + 10};
    const std::string before = "undo-" + std::to_string(++rolled_back_);
    return file_->roll_back(name, {0, before, Timestamp{7}, "operator ann", 0, 0, 0, 0}, epoch, accept);
  }
  [[nodiscard]] State state() {
    const StoredMap stored = file_->load();
    EXPECT_THAT(stored.damage, IsEmpty());
    State now{bytes_of(stored.record), {}, stored.record.keyframe_count};
    for (const LabelRecord& label : stored.labels) now.labels.push_back(label.text);
    return now;
  }
  void expect_back(const std::string& name, const State& then) {
    SCOPED_TRACE("back to " + name);
    const Status rolled_back = roll_back(name);
    ASSERT_TRUE(rolled_back) << rolled_back.error().message;
    const State now = state();
    EXPECT_TRUE(now.map == then.map);
    EXPECT_EQ(now.labels, then.labels);
    EXPECT_EQ(now.keyframes, then.keyframes);
  }
  [[nodiscard]] std::vector<std::string> tag_names() {
    std::vector<std::string> names;
    const auto all = file_->tags();
    EXPECT_TRUE(all);
    for (const MapTag& each : all.value_or(std::vector<MapTag>())) names.push_back(each.name);
    return names;
  }

  const std::filesystem::path path_ = folder_ / "map.cairnmap";
  std::optional<MapFile> file_;
  int rolled_back_ = 0;
};

TEST_F(MapVersionsTest, EveryTagBringsItsStateBackInWhateverOrder) {
  keep();
  ASSERT_TRUE(tag("bare"));
  const State bare = state();
  grow(5, 1, "vice");
  ASSERT_TRUE(tag("three"));
  const State three = state();
  grow(8, 1, "small vice");
  ASSERT_TRUE(tag("four"));
  const State four = state();
  EXPECT_EQ(four.keyframes, bare.keyframes + 2);
  expect_back("bare", bare);
  expect_back("four", four);
  expect_back("three", three);
  // Other keyframes and labels get the ids of those that went; the tags keep theirs.
  take_up();
  grow(11, 2, "lathe");
  EXPECT_EQ(state().labels, (std::vector<std::string>{"vice", "lathe"}));
  expect_back("four", four);
  expect_back("bare", bare);
  // A file that is opened again knows its tags.
  file_.reset();
  file_.emplace(*MapFile::open(path_));
  take_up();
  grow(5, 3, "drill");
  expect_back("three", three);
}

/// Keyframe 3 is one thing in the tag `undo-1` and another in the epoch between, and 4 only in the tag.
TEST_F(MapVersionsTest, TheEpochAfterRollingForwardGivesUpWhatMeantSomethingElseInBetween) {
  keep();
  ASSERT_TRUE(tag("bare"));
  const StoredMap bare = file_->load();
  grow(5, 1, "vice");
  grow(8, 1, "small vice");
  const State grown = state();
  expect_back("bare", {bytes_of(bare.record), {}, 2});
  take_up();
  grow(11, 2, "lathe");
  expect_back("undo-1", grown);
  const StoredMap forward = file_->load();
  EXPECT_EQ(forward.record.keyframe_count, 4U);
  ASSERT_THAT(forward.epochs, SizeIs(3));
  EXPECT_EQ(forward.epochs.back().epoch, forward.header.epoch);
  EXPECT_EQ(forward.epochs.back().keyframes, 2U) << "of the present 4, the epoch before knew 2";
  EXPECT_EQ(forward.epochs.back().points, bare.record.point_count);
  for (const DecisionRecord& decision : forward.decisions)
    EXPECT_FALSE(decision.keyframe) << "of command " << decision.seq << ": another one now";
  // A tag that was made since gives up nothing more than what came after it.
  ASSERT_TRUE(tag("forward"));
  take_up();
  grow(14, 3, "drill");
  expect_back("forward", grown);
  EXPECT_EQ(file_->load().epochs.back().keyframes, 4U);
}

TEST_F(MapVersionsTest, WhatIsNotAcceptedHasNotHappened) {
  keep();
  ASSERT_TRUE(tag("bare"));
  grow(5, 1, "vice");
  const State before = state();
  const Epoch epoch = file_->header().epoch;
  size_t shown = 0;
  const Status refused = roll_back("bare", [&shown](const StoredMap& state) {
    shown = state.record.keyframe_count;
    return fail(ErrorCode::kRefused, "no room");
  });
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "no room");
  EXPECT_EQ(shown, 2U);
  EXPECT_THAT(tag_names(), ElementsAre("bare"));
  for (const bool is_opened_again : {false, true}) {
    if (is_opened_again) file_.emplace(*MapFile::open(path_));
    EXPECT_TRUE(state().map == before.map);
    EXPECT_EQ(file_->header().epoch, epoch);
    EXPECT_THAT(file_->load().epochs, SizeIs(1));
  }
  grow(8, 2, "lathe");
  EXPECT_EQ(state().keyframes, 4U);
}

TEST_F(MapVersionsTest, ATagThatGoesTakesNothingFromTheOthers) {
  keep();
  ASSERT_TRUE(tag("first"));
  const State first = state();
  grow(5, 1, "vice");
  ASSERT_TRUE(tag("second"));
  grow(8, 1, "small vice");
  ASSERT_TRUE(tag("third"));
  const State third = state();
  const Status again = tag("first");
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kRefused);
  EXPECT_THAT(again.error().message, HasSubstr("'first'"));
  ASSERT_TRUE(file_->untag("second"));
  for (const Status& done : {roll_back("second"), file_->untag("second")}) {
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::kNotFound);
    EXPECT_THAT(done.error().message, HasSubstr("no tag 'second'"));
  }
  EXPECT_THAT(tag_names(), ElementsAre("first", "third"));
  grow(11, 2, "lathe");
  expect_back("first", first);
  expect_back("third", third);
  for (const std::string& name : tag_names()) ASSERT_TRUE(file_->untag(name));
  auto database = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
  EXPECT_EQ(*database->number("SELECT count(*) FROM kept"), 0) << "nobody needs it";
}

TEST_F(MapVersionsTest, ATagCostsWhatChangesAfterItAndADamagedOneIsRefused) {
  keep();
  ASSERT_TRUE(tag("now"));
  const State now = state();
  auto database = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
  EXPECT_EQ(*database->number("SELECT count(*) FROM kept"), 0);
  grow(5, 1, "vice");
  const auto kept = *database->number("SELECT sum(length(data)) FROM kept");
  const auto images = *database->number("SELECT sum(length(data)) FROM images");
  EXPECT_GT(kept, 0);
  EXPECT_LT(kept, images) << "no image changes, so none is kept twice";

  const State before = state();
  const std::string last = " WHERE id = (SELECT max(id) FROM kept)";
  ASSERT_TRUE(database->execute("UPDATE kept SET checksum = checksum + 1" + last));
  const Status damaged = roll_back("now");
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().code, ErrorCode::kDamaged);
  EXPECT_THAT(damaged.error().message, HasSubstr("table kept, row"));
  EXPECT_TRUE(state().map == before.map) << "nothing has happened";
  EXPECT_EQ(state().labels, before.labels);
  ASSERT_TRUE(database->execute("UPDATE kept SET checksum = checksum - 1" + last));

  // A command that is sent again is answered as before, but names no keyframe that is another now.
  expect_back("now", now);
  const StoredMap stored = file_->load();
  ASSERT_THAT(stored.decisions, SizeIs(1));
  EXPECT_EQ(stored.decisions[0].seq, 5U);
  EXPECT_FALSE(stored.decisions[0].keyframe);
}

TEST_F(MapVersionsTest, TheStoreTagsWhatThereIsBeforeItRollsBackAndCopiesMaps) {
  auto store = *Store::open(folder_ / "store", null_logger());
  start();
  ASSERT_TRUE(store->create(header_, take_update()));
  const std::vector<uint8_t> bare = bytes_of(store->load(header_.id)->record);
  ASSERT_TRUE(store->tag(header_.id, {0, "bare", {}, "ann", 0, 0, 0, 0}));
  ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  const MapUpdate update = take_update();
  ASSERT_TRUE(store->write(header_.id, {&update, 1}));
  const std::vector<uint8_t> grown = bytes_of(store->load(header_.id)->record);
  const MapTag before{0, "", {}, "ann", 0, 0, 0, 0};
  store->close(header_.id);
  ASSERT_FALSE(store->roll_back(header_.id, "nothing", before, {}));
  EXPECT_THAT(*store->tags(header_.id), SizeIs(1)) << "nothing has happened";
  const Epoch epoch = store->load(header_.id)->header.epoch;
  Epoch shown;
  const AcceptState accept = [&shown](const StoredMap& state) -> Status {
    shown = state.header.epoch;
    return {};
  };
  for (const auto& [name, state] : {std::pair("bare", &bare), std::pair("before-rollback-1", &grown)}) {
    store->close(header_.id);
    ASSERT_TRUE(store->roll_back(header_.id, name, before, accept));
    EXPECT_GT(shown, epoch);
    EXPECT_TRUE(bytes_of(store->load(header_.id)->record) == *state);
  }

  const MapId copy{{9, 9}};
  ASSERT_TRUE(store->copy_map(header_.id, copy, "desk-2"));
  const auto copied = store->load(copy);
  ASSERT_TRUE(copied);
  EXPECT_TRUE(bytes_of(copied->record) == grown);
  EXPECT_EQ(copied->header.name, "desk-2");
  EXPECT_THAT(*store->tags(copy), IsEmpty());
}

}  // namespace
}  // namespace cairn
