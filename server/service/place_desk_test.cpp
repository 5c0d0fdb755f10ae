// SPDX-License-Identifier: Apache-2.0
#include "server/service/place_desk.h"

#include <gtest/gtest.h>

#include <future>

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

PlaceQuery query_of(const KeyframeView& keyframe) {
  PlaceQuery query;
  query.camera = keyframe.camera;
  query.view.small.assign(keyframe.pyramid->level(kPyramidLevels - 1));
  query.lockstep = true;
  return query;
}

class PlaceDeskTest : public ::testing::Test {
 protected:
  PlaceDeskTest() : indexers_(1, 0, make_logger("test")), answerers_(1, 0, make_logger("test")) {
    options_.method = RelocMethod::kPaper;  // answers by pictures alone
    desk_ = std::make_shared<PlaceDesk>(indexers_, answerers_, options_, null_logger());
  }
  PlaceAnswer ask(const KeyframeView& keyframe) {
    std::promise<PlaceAnswer> answer;
    desk_->ask(query_of(keyframe), [&](PlaceAnswer said) { answer.set_value(std::move(said)); });
    return answer.get_future().get();
  }

  WorkerPool indexers_;
  WorkerPool answerers_;
  RelocOptions options_;
  std::shared_ptr<PlaceDesk> desk_;
};

TEST_F(PlaceDeskTest, ALockstepQuestionIsAnsweredWithAllThatWasReported) {
  const KeyframeView first = flat_keyframe(1, 3);
  const KeyframeView second = flat_keyframe(2, 7);
  EXPECT_EQ(ask(first).verdict, PlaceVerdict::kNotKnown);
  for (int round = 0; round < 50; ++round) {
    desk_->report(snapshot_with(1, 1), {first});
    EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{1});
    desk_->report(snapshot_with(1, 2), {first, second});
    EXPECT_EQ(ask(second).candidates.front().keyframe, KeyframeId{2});
  }
}

TEST_F(PlaceDeskTest, ARemovedMapIsNotAnswered) {
  const KeyframeView keyframe = flat_keyframe(1, 3);
  desk_->report(snapshot_with(1, 1), {keyframe});
  desk_->report(snapshot_with(2, 1), {keyframe});
  desk_->remove(snapshot_with(1, 1)->map);
  EXPECT_EQ(ask(keyframe).candidates.front().map, snapshot_with(2, 1)->map);
  desk_->remove(snapshot_with(2, 1)->map);
  EXPECT_EQ(ask(keyframe).verdict, PlaceVerdict::kNotKnown);
}

}  // namespace
}  // namespace cairn
