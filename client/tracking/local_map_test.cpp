// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/local_map.h"

#include <gtest/gtest.h>

#include <chrono>

#include "client/tracking/seeded_tracker.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

SE3 shifted(double x) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(x, 0, 0)};
}

MapSnapshotPtr map_with(std::vector<KeyframePose> keyframes) {
  auto map = std::make_shared<MapSnapshot>();
  auto block = std::make_shared<KeyframeBlock>();
  block->live = ~uint64_t{0} >> (kBlockSlots - keyframes.size());
  block->keyframes = std::move(keyframes);
  map->keyframe_blocks.push_back(std::move(block));
  return map;
}

LocalPoint point(uint64_t number, const Eigen::Vector3d& position) {
  LocalPoint made;
  made.number = number;
  made.position = position;
  made.right = {0.01, 0, 0};
  made.down = {0, 0.01, 0};
  return made;
}

KeyframeProposal proposal(uint64_t number, KeyframeId reference, const SE3& camera_from_reference) {
  KeyframeProposal made;
  made.number = number;
  made.reference = reference;
  made.camera_from_reference = camera_from_reference;
  return made;
}

constexpr KeyframeId kFirst{kLocalBit | 1};
constexpr KeyframeId kSecond{kLocalBit | 2};

class LocalMapTest : public ::testing::Test {
 protected:
  Timestamp at(int ms) const { return Timestamp{} + milliseconds(ms); }
  void advance(int ms) {
    counted_.clear();
    local_.advance(at(ms), &counted_);
  }
  MapSnapshotPtr map_ = map_with({{KeyframeId{1}, SE3(), 1}});
  LocalMap local_{LocalMapOptions()};
  std::vector<uint64_t> counted_;
};

TEST_F(LocalMapTest, AKeyframeCountsOnceItsAnswerIsOverdue) {
  const std::vector<LocalPoint> points{point(7, {0, 0, 2})};
  local_.propose(proposal(1, KeyframeId{1}, shifted(-0.1)), shifted(-0.1), 2, at(0), points, {});
  advance(100);
  EXPECT_EQ(local_.extend(map_), map_) << "the server may still answer";
  EXPECT_TRUE(counted_.empty());
  advance(400);
  EXPECT_EQ(counted_, std::vector<uint64_t>{7});
  const MapSnapshotPtr extended = local_.extend(map_);
  EXPECT_EQ(local_.extend(map_), extended) << "nothing has changed";
  ASSERT_NE(extended->find(kFirst), nullptr);
  ASSERT_EQ(extended->point_count(), 1U);
  const PointBlock& block = *extended->point_blocks.back();
  EXPECT_TRUE(is_local(block.ids[0]));
  EXPECT_LT((block.position(0) - Eigen::Vector3d(0, 0, 2)).norm(), 1e-6);
  EXPECT_LT((block.right[0] - Eigen::Vector3f(0.01F, 0, 0)).norm(), 1e-6F);
}

TEST_F(LocalMapTest, WhatIsAnsweredInTimeNeverCounts) {
  local_.propose(proposal(1, KeyframeId{1}, shifted(-0.1)), shifted(-0.1), 2, at(0), {}, {});
  local_.answered(1, KeyframeId{2});
  advance(1000);
  EXPECT_EQ(local_.extend(map_), map_);
  EXPECT_FALSE(local_.is_overdue());
  EXPECT_EQ(local_.keyframe_count(), 0U);
}

TEST_F(LocalMapTest, AChainRidesOnAdjustmentsAndHandsOverToTheServersMap) {
  const std::vector<LocalPoint> points{point(7, {0, 0, 2})};
  local_.propose(proposal(1, KeyframeId{1}, shifted(-0.1)), shifted(-0.1), 2, at(0), {}, {});
  local_.propose(proposal(2, kFirst, shifted(-0.1)), shifted(-0.2), 2, at(300), points, {});
  advance(700);
  const auto adjusted = map_with({{KeyframeId{1}, shifted(0.5), 1}});
  EXPECT_NEAR(local_.extend(adjusted)->find(kSecond)->camera_from_map.translation().x(), 0.3, 1e-12);

  local_.answered(1, KeyframeId{2});
  const auto grown = map_with({{KeyframeId{1}, SE3(), 1}, {KeyframeId{2}, shifted(-0.12), 1}});
  const MapSnapshotPtr both = local_.extend(grown);
  EXPECT_NEAR(both->find(kSecond)->camera_from_map.translation().x(), -0.22, 1e-12)
      << "the rest goes with it";
  EXPECT_NEAR(both->point_blocks.back()->position(0).x(), 0.02, 1e-6);
  advance(1800);
  EXPECT_EQ(local_.extend(grown)->find(kFirst), nullptr) << "the server's serves in its place";
  EXPECT_NEAR(local_.extend(grown)->find(kSecond)->camera_from_map.translation().x(), -0.22, 1e-12);

  local_.answered(2, std::nullopt);
  advance(1900);
  (void)local_.extend(map_with({{KeyframeId{1}, SE3(), 1}, {KeyframeId{2}, shifted(-0.12), 1}}));
  advance(3000);
  EXPECT_EQ(local_.extend(grown), grown) << "all is answered: one map";
  EXPECT_EQ(local_.keyframe_count(), 0U);
}

/// The server's map of two keyframes, as long as it says.
MapSnapshotPtr map_of_epoch(uint64_t epoch, double length) {
  auto map = std::make_shared<MapSnapshot>(
      *map_with({{KeyframeId{1}, SE3(), 1}, {KeyframeId{2}, shifted(-length), 1}}));
  map->epoch = Epoch{epoch};
  return map;
}

TEST_F(LocalMapTest, AServerThatStartsAnewTakesNothingAwayUnlessLengthsAreOthers) {
  (void)local_.extend(map_of_epoch(1, 1));
  local_.propose(proposal(1, KeyframeId{2}, shifted(-0.1)), shifted(-1.1), 2, at(0), {}, {});
  advance(1000);
  EXPECT_NE(local_.extend(map_of_epoch(1, 1))->find(kFirst), nullptr);
  EXPECT_NE(local_.extend(map_of_epoch(2, 1.02))->find(kFirst), nullptr);
  EXPECT_EQ(local_.extend(map_of_epoch(3, 2))->find(kFirst), nullptr);
}

TEST_F(LocalMapTest, AMapThatIsTriedTakesNothingAwayBeforeTheCameraIsKnownInIt) {
  local_.propose(proposal(1, KeyframeId{1}, shifted(-0.1)), shifted(-0.1), 2, at(0), {}, {});
  (void)local_.extend(map_);
  advance(1000);
  auto other = std::make_shared<MapSnapshot>(*map_);
  other->map.bytes[0] ^= 1;
  EXPECT_EQ(local_.extend(other), other);
  local_.settle_in(map_->map);
  EXPECT_NE(local_.extend(map_)->find(kFirst), nullptr);
  local_.settle_in(other->map);
  EXPECT_EQ(local_.extend(map_)->find(kFirst), nullptr);
}

TEST_F(LocalMapTest, IsBounded) {
  uint64_t points_made = 0;
  for (uint64_t number = 1; number <= 2 * LocalMapOptions().most_keyframes; ++number) {
    std::vector<LocalPoint> points;
    for (int i = 0; i < 100; ++i) points.push_back(point(++points_made, {0, 0, 2}));
    local_.propose(proposal(number, KeyframeId{1}, SE3()), SE3(), 2, at(300 * static_cast<int>(number)),
                   points, {});
  }
  EXPECT_EQ(local_.keyframe_count(), LocalMapOptions().most_keyframes);
  EXPECT_LE(local_.point_count(), LocalMapOptions().most_points);
  EXPECT_GT(local_.point_count(), LocalMapOptions().most_points / 2);
}

TEST_F(LocalMapTest, OnceAnAnswerIsOverdueNewerKeyframesCountAtOnce) {
  local_.propose(proposal(1, KeyframeId{1}, shifted(-0.1)), shifted(-0.1), 2, at(0), {}, {});
  local_.propose(proposal(2, KeyframeId{1}, shifted(-0.2)), shifted(-0.2), 2, at(290), {}, {});
  advance(299);
  EXPECT_EQ(local_.extend(map_), map_);
  advance(300);
  EXPECT_NE(local_.extend(map_)->find(kSecond), nullptr);
}

/// Keyframes along a line before a wall with relief, each of which has measured all points that it shows
/// exactly; the newest believe themselves, and their points, somewhere else.
class LocalAdjustment : public LocalMapTest {
 protected:
  static constexpr uint64_t kKeyframes = 14;
  static constexpr uint64_t kRight = 6;  ///< the first of them: where they believe that they are
  static constexpr uint64_t kPoints = 40;

  LocalAdjustment() {
    Eigen::Vector3d error(0.012, -0.008, 0.01);
    for (uint64_t number = 1; number <= kKeyframes; ++number) {
      const SE3 truth = true_pose(number);
      error = -error;
      const SE3 believed = number <= kRight ? truth : SE3(truth.rotation(), truth.translation() + error);
      std::vector<LocalPoint> known;
      std::vector<LocalMeasurement> measurements;
      for (uint64_t p = 1; p <= kPoints; ++p) {
        if (number >= 3) known.push_back(point(p, (1 + 0.02 * std::sin(7.0 * p)) * true_point(p)));
        measurements.push_back({{}, p, *camera_->project(truth * true_point(p)), 1});
      }
      local_.propose(proposal(number, KeyframeId{1}, believed), believed, 2, at(static_cast<int>(number)),
                     known, measurements);
    }
    advance(1000);
  }
  static SE3 true_pose(uint64_t number) { return shifted(-0.06 * static_cast<double>(number)); }
  static Eigen::Vector3d true_point(uint64_t p) {
    const auto at = static_cast<double>(p);
    return {0.5 + 0.6 * std::sin(3 * at), 0.5 * std::cos(5 * at), 2 + 0.3 * std::sin(at)};
  }
  double largest_error(const MapSnapshot& map) const {
    double largest = 0;
    for (uint64_t number = 1; number <= kKeyframes; ++number) {
      const KeyframePose* k = map.find(KeyframeId{kLocalBit | number});
      if (k == nullptr) return 1;
      largest = std::max(largest, (k->camera_from_map.center() - true_pose(number).center()).norm());
    }
    for (uint64_t p = 1; p <= kPoints; ++p) {
      const auto slot = map.find(PointId{kLocalBit | p});
      if (!slot) return 1;
      const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
      largest = std::max(largest, (block.position(slot->slot) - true_point(p)).norm());
    }
    return largest;
  }
  CameraPtr camera_ = *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, -0.1, 0.02}});
};

TEST_F(LocalAdjustment, TheNewestKeyframesAndTheirPointsComeToWhereTheyWereMeasured) {
  EXPECT_FALSE(local_.adjust(camera_)) << "no map to adjust in";
  const MapSnapshotPtr before = local_.extend(map_);
  EXPECT_GT(largest_error(*before), 0.01);
  const auto newest = local_.adjust(camera_);
  ASSERT_TRUE(newest);
  const MapSnapshotPtr after = local_.extend(map_);
  EXPECT_LT(
      (newest->center() - after->find(KeyframeId{kLocalBit | kKeyframes})->camera_from_map.center()).norm(),
      1e-9);
  EXPECT_LT(largest_error(*after), 1e-3);
  for (uint64_t number = 1; number <= kRight; ++number) {
    const KeyframeId id{kLocalBit | number};
    EXPECT_LT((before->find(id)->camera_from_map.center() - after->find(id)->camera_from_map.center()).norm(),
              1e-9)
        << "an older one stays";
  }
}

TEST_F(LocalAdjustment, WhatTheServerHasTakenInStays) {
  const KeyframeId taken{kLocalBit | kKeyframes};
  const auto grown = map_with({{KeyframeId{1}, SE3(), 1}, {KeyframeId{2}, shifted(-1), 1}});
  (void)local_.extend(grown);
  const auto moves = local_.adjust(camera_);
  local_.answered(kKeyframes, KeyframeId{2});
  (void)local_.extend(grown);
  const auto stays = local_.adjust(camera_);
  ASSERT_TRUE(moves && stays);
  EXPECT_EQ(stays->translation(), moves->translation()) << "though it was measured elsewhere";
  EXPECT_EQ(local_.extend(grown)->find(taken)->camera_from_map.translation(), shifted(-1).translation());
}

/// A tracker whose server never answers, on a map of one view of a plane.
TEST(LocalMapTracker, ACameraThatExploresWithoutAServerIsTrackedForAMinute) {
  const auto camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
  const Eigen::Quaterniond down(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  const auto over = [&](double x, double y) { return SE3(down, -(down * Eigen::Vector3d(x, y, 1))); };
  test::TrackerOnPlane plane(camera, over(0, 0));
  constexpr int kFrames = 150;
  // A minute of 30 frames a second would take longer than all other tests. The clock alone is quick: from
  // frame to frame the camera moves as far as one at 0.5 m/s does in video, seen from 1 m.
  constexpr double kStep = 0.4;  // [s]
  constexpr double kCircle = 0.4;
  const double path = 2 * M_PI * kCircle;  // [m]
  uint64_t last = 0;
  double worst = 0;
  for (int i = -5; i < kFrames; ++i) {
    const double angle = 2 * M_PI * std::max(0, i) / kFrames;
    const SE3 truth = over(kCircle * std::sin(angle), kCircle - kCircle * std::cos(angle));
    const double second = i < 0 ? i / 30.0 : kStep * i;  // found first
    const FrameResult& result =
        plane.tracker.track(plane.scene.render(truth), Timestamp::from_seconds(0.2 + second), plane.map);
    if (result.reloc_query) plane.tracker.relocalization_answered(std::nullopt);
    if (i < 0) continue;
    ASSERT_TRUE(result.pose_measured) << "frame " << i << ": " << result.note;
    worst = std::max(worst, (result.camera_from_map.center() - truth.center()).norm());
    if (!result.keyframe) continue;
    EXPECT_EQ(result.keyframe->number, last + 1) << "in order";
    EXPECT_LE(result.keyframe->reference_number, last) << "an earlier one";
    last = result.keyframe->number;
  }
  EXPECT_LT(worst, 0.01 * path);
  EXPECT_GT(last, 5U);
}

}  // namespace
}  // namespace cairn
