// SPDX-License-Identifier: Apache-2.0
// When keyframes are asked about; what comes of the answers: server/relocalization/overlap_detector_test.
#include "server/service/overlap_watch.h"

#include <gtest/gtest.h>

#include <future>
#include <nlohmann/json.hpp>

#include "server/service/work_times_json.h"
#include "server/service/worker_pool.h"

namespace cairn {
namespace {

using Corners = std::array<CornerList, kPyramidLevels>;

KeyframeView keyframe(uint64_t id) {
  auto pyramid = std::make_shared<Pyramid>();
  pyramid->build(GrayImage(320, 240));
  return {{id},
          *make_camera({CameraModel::kPinholeRadtan, 320, 240, {250, 250, 160, 120}}),
          pyramid,
          {},
          std::make_shared<const Corners>()};
}

KeyframeView without_image(uint64_t id) {
  KeyframeView view = keyframe(id);
  view.pyramid = nullptr;
  return view;
}

IndexedMapPtr map_of(uint8_t id, const std::vector<KeyframeView>& views) {
  auto block = std::make_shared<KeyframeBlock>();
  for (const KeyframeView& view : views) {
    block->keyframes.push_back({view.id, SE3(), 1});
    block->live |= uint64_t{1} << (block->keyframes.size() - 1);
  }
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->map = MapId{{id}};
  snapshot->keyframe_blocks = {block};
  std::vector<KeyframeView> with_images;
  for (const KeyframeView& view : views) with_images.push_back(keyframe(view.id.value));
  return index_map(nullptr, snapshot, with_images, GravityOptions());
}

class OverlapWatchTest : public ::testing::Test {
 protected:
  OverlapWatchTest() { index_.put(map_of(9, {keyframe(1)})); }

  void search(uint8_t id, const std::vector<KeyframeView>& views) {
    const IndexedMapPtr map = map_of(id, views);
    index_.put(map);
    watch_->note_searched(map, views);
  }
  /// How many keyframes have been asked about, once all that waits is done.
  int asked() {
    std::promise<void> done;
    executor_.submit([&done] { done.set_value(); });
    done.get_future().wait();
    return nlohmann::json::parse(to_json(times_.summaries()))
        .at("overlap_check_cpu_ms")
        .at("count")
        .get<int>();
  }
  /// What is submitted from here on waits until then.
  std::promise<void> hold_executor() {
    std::promise<void> release;
    executor_.submit([until = release.get_future().share()] { until.wait(); });
    return release;
  }

  WorkTimes times_;
  PlaceIndex index_;
  WorkerPool executor_{1, 0, null_logger()};
  std::shared_ptr<OverlapWatch> watch_ = std::make_shared<OverlapWatch>(
      executor_, RelocOptions(), [this] { return std::make_shared<const PlaceIndex>(index_); },
      [](const Overlap&) { FAIL() << "grey images"; }, null_logger(), &times_);
};

TEST_F(OverlapWatchTest, EachNewKeyframeIsAskedAboutOnce) {
  search(1, {keyframe(1)});
  EXPECT_EQ(asked(), 1);
  search(1, {keyframe(1)});  // an adjustment
  EXPECT_EQ(asked(), 1);
  search(1, {keyframe(1), keyframe(2)});
  EXPECT_EQ(asked(), 2);
  search(2, {keyframe(1)});
  EXPECT_EQ(asked(), 3);
}

TEST_F(OverlapWatchTest, OfAMapThatGrowsFasterEightKeyframesWait) {
  std::promise<void> release = hold_executor();
  for (size_t count = 1; count <= 12; ++count) {
    std::vector<KeyframeView> views;
    for (uint64_t id = 1; id <= count; ++id) views.push_back(keyframe(id));
    search(1, views);
  }
  search(2, {keyframe(1)});
  release.set_value();
  EXPECT_EQ(asked(), 8 + 1);
}

TEST_F(OverlapWatchTest, WhatTheStoreBroughtIsNotAskedAboutAgain) {
  search(1, {without_image(1), without_image(2)});
  search(1, {keyframe(1), keyframe(2)});  // it is in use again
  EXPECT_EQ(asked(), 0);
  search(1, {keyframe(1), keyframe(2), keyframe(3)});
  EXPECT_EQ(asked(), 1);
}

TEST_F(OverlapWatchTest, AMapThatIsGoneOrAloneIsNotAskedAbout) {
  std::promise<void> release = hold_executor();
  search(1, {keyframe(1)});
  watch_->remove(MapId{{1}});
  release.set_value();
  EXPECT_EQ(asked(), 0);
  index_.remove(MapId{{9}});
  index_.remove(MapId{{1}});
  search(2, {keyframe(1)});
  EXPECT_EQ(asked(), 0);
}

}  // namespace
}  // namespace cairn
