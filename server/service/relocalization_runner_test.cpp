// SPDX-License-Identifier: Apache-2.0
#include "server/service/relocalization_runner.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <nlohmann/json.hpp>

#include "server/service/system_clock.h"
#include "server/service/work_times_json.h"
#include "server/service/worker_pool.h"

namespace cairn {
namespace {

KeyframeView flat_keyframe(uint64_t id, int brightness_step) {
  const auto camera = make_camera({CameraModel::kPinholeRadtan, 320, 240, {250, 250, 160, 120}});
  GrayImage image(320, 240);
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) image.row(y)[x] = static_cast<uint8_t>(x * brightness_step / 8 % 256);
  }
  auto pyramid = std::make_shared<Pyramid>();
  pyramid->build(image);
  return {{id}, *camera, pyramid, {}};
}

MapSnapshotPtr snapshot_with(uint8_t id, size_t keyframes) {
  auto block = std::make_shared<KeyframeBlock>();
  for (size_t i = 1; i <= keyframes; ++i) {
    block->keyframes.push_back({{i}, SE3(), 1});
    block->live |= uint64_t{1} << (i - 1);
  }
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->map.bytes[0] = id;
  snapshot->keyframe_blocks = {block};
  return snapshot;
}

RelocalizationQuery query_of(const KeyframeView& keyframe, bool lockstep) {
  RelocalizationQuery query;
  query.camera = keyframe.camera;
  query.view.small.assign(keyframe.pyramid->level(kPyramidLevels - 1));
  query.lockstep = lockstep;
  return query;
}

class RelocalizationRunnerTest : public ::testing::Test {
 protected:
  RelocalizationRunnerTest() {
    options_.method = RelocMethod::kPaper;  // answers by images alone
    open_desk();
  }
  void open_desk() {
    runner_ = std::make_shared<RelocalizationRunner>(
        RelocalizationRunner::Executors{indexers_, answerers_, planters_}, options_,
        std::make_shared<SystemClock>(), null_logger(), &times_);
  }
  [[nodiscard]] int searchable() const {
    return nlohmann::json::parse(to_json(times_.summaries()))
        .at("offer_to_searchable_ms")
        .at("count")
        .get<int>();
  }
  RelocalizationAnswer ask(const KeyframeView& keyframe, bool lockstep = true) {
    std::promise<RelocalizationAnswer> answer;
    runner_->ask(query_of(keyframe, lockstep),
                 [&](RelocalizationAnswer said) { answer.set_value(std::move(said)); });
    return answer.get_future().get();
  }

  /// Asks until the keyframe that looks most like this one is of that map, or it has taken too long.
  [[nodiscard]] bool is_found_in(const MapId& map, const KeyframeView& keyframe) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (std::chrono::steady_clock::now() < deadline) {
      const RelocalizationAnswer answer = ask(keyframe, false);
      if (answer.candidates.empty()) continue;
      const PlaceCandidate& best = answer.candidates.front();
      if (best.map == map && best.keyframe == keyframe.id) return true;
    }
    return false;
  }

  WorkerPool indexers_{1, 0, make_logger("test")};
  WorkerPool answerers_{1, 0, make_logger("test")};
  WorkerPool planters_{1, 0, make_logger("test")};
  RelocOptions options_;
  WorkTimes times_;
  std::shared_ptr<RelocalizationRunner> runner_;
};

TEST_F(RelocalizationRunnerTest, ALockstepQueryIsAnsweredWithAllThatWasReported) {
  const KeyframeView first = flat_keyframe(1, 3);
  const KeyframeView second = flat_keyframe(2, 7);
  EXPECT_EQ(ask(first).verdict, RelocalizationVerdict::kNotKnown);
  for (int round = 0; round < 50; ++round) {
    runner_->report(snapshot_with(1, 1), {first});
    EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{1});
    runner_->report(snapshot_with(1, 2), {first, second});
    EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{2});
  }
}

TEST_F(RelocalizationRunnerTest, AnImageThatWasEvictedIsFoundAsItWasIndexed) {
  const auto without_image = [](KeyframeView view) {
    view.pyramid = nullptr;
    return view;
  };
  const KeyframeView first = flat_keyframe(1, 3);
  const KeyframeView second = flat_keyframe(2, 7);
  runner_->report(snapshot_with(1, 2), {first, without_image(second)});
  EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{1}) << "never seen: left out";
  runner_->report(snapshot_with(1, 2), {without_image(first), second});
  EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{2});
  runner_->report(snapshot_with(1, 2), {without_image(first), without_image(second)});
  EXPECT_EQ(ask(first).candidates.front().keyframe, KeyframeId{1});
  KeyframeView measured_anew = without_image(second);
  measured_anew.measurements.push_back({PointId{1}, 0, {10, 10}});
  runner_->report(snapshot_with(1, 2), {without_image(first), measured_anew});
  EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{2});
  const auto indexed = index_map(nullptr, snapshot_with(2, 2), std::vector{first, second}, GravityOptions());
  runner_->remove(snapshot_with(1, 2)->map);
  runner_->report(indexed->snapshot, {without_image(first), without_image(second)}, indexed);
  runner_->report(indexed->snapshot, {without_image(first), without_image(second)});
  EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{2});
}

TEST_F(RelocalizationRunnerTest, AKeyframeIsCountedOnceItIsSearchableAlsoOfAStateThatWasPassedOver) {
  const MonotonicTime now = std::chrono::steady_clock::now();
  std::promise<void> indexing_may_begin;
  indexers_.submit([may_begin = indexing_may_begin.get_future().share()] { may_begin.wait(); });
  runner_->report(snapshot_with(1, 1), {flat_keyframe(1, 3)}, {}, {now});
  runner_->report(snapshot_with(1, 2), {flat_keyframe(1, 3), flat_keyframe(2, 5)}, {}, {now});
  EXPECT_EQ(searchable(), 0);
  indexing_may_begin.set_value();
  EXPECT_EQ(ask(flat_keyframe(2, 5)).candidates.front().keyframe, KeyframeId{2});
  EXPECT_EQ(searchable(), 2);
  runner_->report(snapshot_with(1, 2), {flat_keyframe(1, 3), flat_keyframe(2, 5)});
  EXPECT_EQ(ask(flat_keyframe(1, 3)).candidates.front().keyframe, KeyframeId{1});
  EXPECT_EQ(searchable(), 2);
}

TEST_F(RelocalizationRunnerTest, WhoListensIsToldInOrderWhatIsSearchedByThen) {
  std::vector<std::pair<MapId, size_t>> told;  // 0 keyframes: removed
  runner_->listen({[&](const IndexedMapPtr& map, std::span<const KeyframeView> views) {
                     EXPECT_EQ(runner_->index()->find(map->snapshot->map), map.get());
                     EXPECT_EQ(views.size(), map->keyframes.size());
                     told.emplace_back(map->snapshot->map, map->keyframes.size());
                   },
                   [&](const MapId& map) {
                     EXPECT_EQ(runner_->index()->find(map), nullptr);
                     told.emplace_back(map, 0);
                   }});
  const KeyframeView first = flat_keyframe(1, 3);
  const KeyframeView second = flat_keyframe(2, 7);
  const MapId map = snapshot_with(1, 0)->map;
  runner_->report(snapshot_with(1, 1), {first});
  (void)ask(first);
  runner_->report(snapshot_with(1, 2), {first, second});
  (void)ask(first);
  runner_->remove(map);
  (void)ask(first);
  EXPECT_EQ(told, (std::vector<std::pair<MapId, size_t>>{{map, 1}, {map, 2}, {map, 0}}));
}

TEST_F(RelocalizationRunnerTest, ARemovedMapIsNotAnswered) {
  const KeyframeView keyframe = flat_keyframe(1, 3);
  runner_->report(snapshot_with(1, 1), {keyframe});
  runner_->report(snapshot_with(2, 1), {keyframe});
  runner_->remove(snapshot_with(1, 1)->map);
  EXPECT_EQ(ask(keyframe).candidates.front().map, snapshot_with(2, 1)->map);
  runner_->remove(snapshot_with(2, 1)->map);
  EXPECT_EQ(ask(keyframe).verdict, RelocalizationVerdict::kNotKnown);
}

TEST_F(RelocalizationRunnerTest, AKeyframeIsFoundBeforeItIsInTheForestAndAfter) {
  options_.method = RelocMethod::kImproved;
  options_.most_scanned = 4;
  open_desk();
  std::promise<void> planting_may_begin;
  planters_.submit([may_begin = planting_may_begin.get_future().share()] { may_begin.wait(); });
  std::vector<KeyframeView> keyframes;
  // Steps at which brightness wraps round: ramps alone are alike but for their gain.
  for (uint64_t id = 1; id <= 9; ++id) keyframes.push_back(flat_keyframe(id, 7 + 2 * static_cast<int>(id)));
  const MapId map = snapshot_with(1, 0)->map;
  const std::vector<KeyframeView> early(keyframes.begin(), keyframes.begin() + 6);
  runner_->report(snapshot_with(1, early.size()), early);
  for (const KeyframeView& k : early) EXPECT_TRUE(is_found_in(map, k));
  runner_->report(snapshot_with(1, keyframes.size()), keyframes);
  for (const KeyframeView& k : keyframes) EXPECT_TRUE(is_found_in(map, k));
  EXPECT_EQ(runner_->index()->forest(), nullptr);

  planting_may_begin.set_value();
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (runner_->index()->forest() == nullptr) ASSERT_LT(std::chrono::steady_clock::now(), deadline);
  EXPECT_EQ(runner_->index()->planted().size(), keyframes.size());
  for (const KeyframeView& k : keyframes) EXPECT_TRUE(is_found_in(map, k));
  const KeyframeView elsewhere = flat_keyframe(1, 31);
  runner_->report(snapshot_with(2, 1), {elsewhere});
  EXPECT_TRUE(is_found_in(snapshot_with(2, 1)->map, elsewhere));
  EXPECT_EQ(runner_->index()->planted().size(), keyframes.size());

  runner_->remove(map);  // and with it the forest, as too little is left
  while (runner_->index()->forest() != nullptr) ASSERT_LT(std::chrono::steady_clock::now(), deadline);
  EXPECT_TRUE(is_found_in(snapshot_with(2, 1)->map, elsewhere));
  for (const KeyframeView& k : keyframes)
    for (const PlaceCandidate& c : ask(k, false).candidates) EXPECT_NE(c.map, map);
}

}  // namespace
}  // namespace cairn
