// SPDX-License-Identifier: Apache-2.0
//
// A map that has lived so long that nearly all its places are taken by what was removed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/mapping/map_record.h"
#include "server/service/simulation/lone_client_fixture.h"
#include "server/store/store.h"

namespace cairn::simulation {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class CrowdedMap : public LoneClientFixture {
 protected:
  /// Between two starts of the server: points come and go, many times as many as live.
  void live_long() {
    server_->end();
    const auto store = Store::open(directory_.path(), null_logger());
    ASSERT_TRUE(store) << store.error().message;
    const StoredMap kept = *(*store)->load(map_);
    MapState state = assemble_map(kept.record, RestoredImages::kStay)->state;
    MapRecorder recorder;
    (void)recorder.take(state, *kept.record.foundation, *kept.record.work);
    const size_t living = state.live_points();
    const PointSource source = *state.point(state.live_point_ids().front()).source;
    while (state.points().size() < 5 * living) state.remove_point(state.add_point(source, {0, 0, 1}));
    ASSERT_EQ(state.live_points(), living);
    const MapUpdate update{recorder.take(state, *kept.record.foundation, *kept.record.work), {}, {}, {}};
    ASSERT_TRUE((*store)->write(map_, {&update, 1}));
    adjust_ = [most = state.points().size() + 100](MapServiceOptions& options) {
      options.mapping.max_points = most;
      options.compact_after = std::chrono::minutes(1);
    };
  }
  [[nodiscard]] std::string told_of(const std::string& request) {
    EXPECT_EQ(ask(request), "");
    return reply_ ? reply_->text : std::string();
  }
  /// So long that it is looked for such maps, and nobody uses this one.
  void let_minutes_pass() {
    for (int i = 0; i < 90; ++i) settle();
  }
};

TEST_F(CrowdedMap, IsCompactedWhileNobodyUsesItAndGrowsOn) {
  ASSERT_EQ(ask(R"({"verb": "proposals-welcome", "map": "desk", "welcome": true})"), "");
  const std::string whose = told_of(R"({"verb": "contributors", "map": "desk"})");
  ASSERT_THAT(whose, HasSubstr(kClient));
  live_long();
  begin();
  server_->peers().want(kClient, map_);
  settle();
  const MapSnapshotPtr before = snapshot_;
  EXPECT_THAT(judge(sound_offer(6)), HasSubstr("map is full"));
  let_minutes_pass();
  EXPECT_GT(snapshot_->epoch, before->epoch);
  EXPECT_EQ(snapshot_->point_count(), before->point_count());
  EXPECT_EQ(snapshot_->keyframe_count(), before->keyframe_count());
  EXPECT_LT(snapshot_->point_blocks.size(), before->point_blocks.size() / 2);
  EXPECT_EQ(told_of(R"({"verb": "contributors", "map": "desk"})"), whose);
  EXPECT_THAT(told_of(R"({"verb": "audit"})"), AllOf(HasSubstr("compact"), HasSubstr("proposals welcome")));
  EXPECT_EQ(judge(sound_offer(6)), "");
  const MapSnapshotPtr grown = snapshot_;
  begin_again();
  server_->peers().want(kClient, map_);
  settle();
  EXPECT_EQ(snapshot_->keyframe_count(), grown->keyframe_count());
  EXPECT_EQ(snapshot_->point_count(), grown->point_count());
}

TEST_F(CrowdedMap, ThatHasTagsStaysAsItIsAndSaysSo) {
  ASSERT_EQ(ask(R"({"verb": "tag", "map": "desk", "tag": "bare"})"), "");
  live_long();
  begin();
  server_->peers().want(kClient, map_);
  settle();
  const MapSnapshotPtr before = snapshot_;
  let_minutes_pass();
  EXPECT_EQ(snapshot_->epoch, before->epoch);
  ASSERT_EQ(ask(R"({"verb": "audit", "action": "compact"})"), "");
  EXPECT_THAT(reply_->text, HasSubstr("it has tags"));
  ASSERT_EQ(ask(R"({"verb": "untag", "map": "desk", "tag": "bare"})"), "");
  clock_->advance(std::chrono::hours(1));
  let_minutes_pass();
  EXPECT_GT(snapshot_->epoch, before->epoch);
}

TEST_F(CrowdedMap, IsLeftAloneWhileNothingHasPassedSinceItWasUsed) {
  live_long();
  const auto crowded = adjust_;
  adjust_ = [crowded](MapServiceOptions& options) {
    crowded(options);
    options.compact_after = MapServiceOptions().compact_after;
  };
  begin();
  server_->peers().want(kClient, map_);
  settle();
  const MapSnapshotPtr before = snapshot_;
  let_minutes_pass();
  EXPECT_EQ(snapshot_->epoch, before->epoch);
}

}  // namespace
}  // namespace cairn::simulation
