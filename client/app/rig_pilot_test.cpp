// SPDX-License-Identifier: Apache-2.0
#include "client/app/rig_pilot.h"

#include <gtest/gtest.h>

#include "client/app/viewer/test_map.h"

namespace cairn {
namespace {

using testing::kMap;
using testing::test_camera;
using testing::TestMap;

constexpr PointId kNearTheMiddle{37};  // at 328, 248: 4 columns and 4 rows of the map's points on

class RigPilotTest : public ::testing::Test {
 protected:
  void frame(const TestMap& map, FrameState state = FrameState::kTracking, MapId id = kMap) {
    Frame frame;
    frame.time = {++frames_ * 33'000'000};
    FrameResult result;
    result.map = id;
    result.camera_from_map = camera_from_map_;
    result.points = map.tracked;
    const MapSnapshotPtr snapshot = map.snapshot;
    pilot_.on_frame(
        {static_cast<size_t>(frames_), frame, result, state, snapshot, labels_, {}, {}, {}, {}, {}, {}});
  }
  void put_label(const Eigen::Vector3d& place) {
    Label label;
    label.text = "kettle";
    label.map_from_label = SE3(Eigen::Quaterniond::Identity(), place);
    labels_ = std::make_shared<const std::vector<Label>>(std::vector{label});
  }
  static Eigen::Vector3d place(const TestMap& map, PointId id) {
    const auto slot = map.snapshot->find(id).value();
    return map.snapshot->point_blocks[static_cast<size_t>(slot.block)]->position(slot.slot);
  }
  [[nodiscard]] RigPilot pilot(RigPilotOptions options) {
    return {camera_, std::move(options),
            [this](const std::function<void(RigCommander&)>& task) { task(commander_); }};
  }
  [[nodiscard]] Eigen::Vector3d fixated() const {
    return pilot_.fixated().value_or(Eigen::Vector3d::Constant(1e3));
  }

  CameraPtr camera_ = test_camera();
  SE3 camera_from_map_ = SE3::exp((Vector6d() << -0.3, 0.1, 0.2, 0.1, -0.2, 0.3).finished());
  TestMap map_{*camera_, camera_from_map_};
  /// As an adjustment leaves it.
  TestMap adjusted_{*camera_, SE3(Eigen::Quaterniond::Identity(), {0.1, 0, 0.2}) * camera_from_map_};
  RigCommander commander_{"shoulder",        "eye", {7}, RigAim::kFixate, wire::RigSearchPattern::kSpiral,
                          CommanderOptions()};
  LabelListPtr labels_;
  RigPilot pilot_ = pilot({});
  int64_t frames_ = 0;
};

TEST_F(RigPilotTest, ThePointInTheMiddleIsFixatedWhereverTheMapHasIt) {
  frame(map_, FrameState::kLost);
  EXPECT_FALSE(pilot_.fixated());
  frame(map_);
  EXPECT_EQ(fixated(), place(map_, kNearTheMiddle));
  frame(adjusted_);
  ASSERT_GT((place(map_, kNearTheMiddle) - place(adjusted_, kNearTheMiddle)).norm(), 0.1);
  EXPECT_EQ(fixated(), place(adjusted_, kNearTheMiddle)) << "the map was adjusted";
  TestMap empty = map_;
  empty.snapshot = std::make_shared<MapSnapshot>();
  empty.snapshot->map = kMap;
  frame(empty);
  EXPECT_EQ(fixated(), place(adjusted_, kNearTheMiddle)) << "the point has gone from the map";
}

TEST_F(RigPilotTest, AnotherWishOrAnotherMapBeginsAnew) {
  frame(map_);
  std::erase_if(map_.tracked, [](const TrackedPoint& point) { return point.id == kNearTheMiddle; });
  frame(map_);
  EXPECT_EQ(fixated(), place(map_, kNearTheMiddle)) << "also when it is not found";
  commander_.want(RigAim::kFixate);
  frame(map_);
  EXPECT_NE(fixated(), place(map_, kNearTheMiddle)) << "what is in the middle now";
  map_.snapshot->map = MapId{{8}};
  frame(map_, FrameState::kTracking, MapId{{9}});
  EXPECT_FALSE(pilot_.fixated()) << "a snapshot of another map says nothing of this one";
  commander_.want(RigAim::kFollow);
  frame(map_);
  EXPECT_FALSE(pilot_.fixated());
}

TEST_F(RigPilotTest, ALabelIsFixatedWhereverTheMapHasIt) {
  RigPilotOptions options;
  options.label = "kettle";
  pilot_ = pilot(options);
  frame(map_);
  EXPECT_FALSE(pilot_.fixated()) << "there is no such label";
  put_label({1, 2, 3});
  frame(map_);
  EXPECT_EQ(fixated(), Eigen::Vector3d(1, 2, 3));
  put_label({1, 2, 3.5});
  frame(map_);
  EXPECT_EQ(fixated(), Eigen::Vector3d(1, 2, 3.5)) << "labels move with the map's adjustments";
  labels_ = nullptr;
  frame(map_);
  EXPECT_EQ(fixated(), Eigen::Vector3d(1, 2, 3.5)) << "it was removed";
}

TEST_F(RigPilotTest, WhoMakesNoMapsIsLostWithoutOne) {
  RigPilotOptions reader;
  reader.makes_maps = false;
  for (const auto& [options, searches] : {std::pair{RigPilotOptions{}, 0}, {reader, 1}}) {
    pilot_ = pilot(options);
    for (int i = 0; i < 20; ++i) frame(map_, FrameState::kStarting);
    EXPECT_EQ(commander_.counts().searches, searches);
  }
}

}  // namespace
}  // namespace cairn
