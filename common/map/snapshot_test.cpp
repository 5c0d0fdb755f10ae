// SPDX-License-Identifier: Apache-2.0
#include "common/map/snapshot.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>

namespace cairn {
namespace {

constexpr unsigned kSeed = 20240711;
constexpr double kPixel = 1.0 / 500;  // size of one pixel at unit depth of the cameras below

class SnapshotTest : public ::testing::Test {
 protected:
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Eigen::Vector3d direction() {
    return Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized();
  }
  SE3 pose() {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(uniform(-3, 3), direction())),
            Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1))};
  }

  /// A point of a plane facing the source camera within 60 degrees, seen by a pinhole without distortion.
  PointSource source(PointId id, KeyframeId keyframe) {
    const Eigen::Vector2d at(uniform(-0.4, 0.4), uniform(-0.3, 0.3));
    const auto ray = [&](double dx, double dy) -> Eigen::Vector3f {
      return Eigen::Vector3d(at.x() + dx * kPixel, at.y() + dy * kPixel, 1).normalized().cast<float>();
    };
    PointSource point;
    point.id = id;
    point.keyframe = keyframe;
    point.ray_center = ray(0, 0);
    point.ray_right = ray(1, 0);
    point.ray_down = ray(0, 1);
    Eigen::Vector3d normal;
    do {
      normal = direction();
    } while (normal.dot(point.ray_center.cast<double>()) > -0.5);
    point.normal = normal.cast<float>();
    return point;
  }

  static std::shared_ptr<const KeyframeBlock> keyframe_block(const std::vector<KeyframePose>& poses,
                                                             uint64_t live = ~uint64_t{0}) {
    auto block = std::make_shared<KeyframeBlock>();
    block->keyframes = poses;
    block->live = poses.size() == kBlockSlots ? live : live & ((uint64_t{1} << poses.size()) - 1);
    return block;
  }

  struct Blocks {
    std::shared_ptr<PatchBlock> patches = std::make_shared<PatchBlock>();
    std::shared_ptr<PositionBlock> positions = std::make_shared<PositionBlock>();
  };
  /// `count` points of ids first_id, first_id + 2, ... on their source rays at depths 1 to 3.
  Blocks blocks(uint64_t first_id, size_t count, KeyframeId keyframe, const SE3& camera_from_map) {
    Blocks made;
    for (size_t s = 0; s < count; ++s) {
      const PointSource point = source({first_id + 2 * s}, keyframe);
      const Eigen::Vector3d in_camera = uniform(1, 3) * point.ray_center.cast<double>();
      made.patches->points.push_back(point);
      made.positions->positions.emplace_back(
          (camera_from_map.rotation().conjugate() * (in_camera - camera_from_map.translation()))
              .cast<float>());
      made.positions->live |= uint64_t{1} << s;
    }
    made.positions->visibility.resize(count);
    return made;
  }

  std::mt19937 random_{kSeed};
};

TEST_F(SnapshotTest, PatchVectorsSpanOnePixelOfTheSourceViewOnThePlane) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  const SE3 camera_from_map = pose();
  const Blocks made = blocks(1, kBlockSlots, {1}, camera_from_map);
  const auto block =
      make_point_block(made.patches, made.positions, {keyframe_block({{{1}, camera_from_map, 2}})});
  ASSERT_EQ(block->count, kBlockSlots);
  EXPECT_EQ(block->live, ~uint64_t{0});
  EXPECT_EQ(block->positions, made.positions) << "nothing was lost, so the block is shared";
  for (int s = 0; s < kBlockSlots; ++s) {
    const auto i = static_cast<size_t>(s);
    const Eigen::Vector3d center = camera_from_map * block->position(s);
    const Eigen::Vector3d right = camera_from_map * (block->position(s) + block->right[i].cast<double>());
    const Eigen::Vector3d down = camera_from_map * (block->position(s) + block->down[i].cast<double>());
    const Eigen::Vector2d pixel = center.hnormalized() / kPixel;
    EXPECT_LT((right.hnormalized() / kPixel - pixel - Eigen::Vector2d(1, 0)).norm(), 2e-3) << "slot " << s;
    EXPECT_LT((down.hnormalized() / kPixel - pixel - Eigen::Vector2d(0, 1)).norm(), 2e-3) << "slot " << s;
    const Eigen::Vector3d normal = block->source(s).normal.cast<double>();
    EXPECT_NEAR(normal.dot((right - center).normalized()), 0, 1e-3);
    EXPECT_NEAR(normal.dot((down - center).normalized()), 0, 1e-3);
  }
}

TEST_F(SnapshotTest, BoundingSphereHoldsTheLivePointsOnly) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  const SE3 camera_from_map = pose();
  Blocks made = blocks(1, 20, {1}, camera_from_map);
  made.positions->positions[7] = camera_from_map.center().cast<float>() + Eigen::Vector3f(1e6F, 0, 0);
  made.positions->live &= ~(uint64_t{1} << 7);
  const auto block =
      make_point_block(made.patches, made.positions, {keyframe_block({{{1}, camera_from_map, 2}})});
  EXPECT_LT(block->radius, 10);
  for (int s = 0; s < block->count; ++s) {
    if (s == 7) continue;
    EXPECT_LE((block->position(s).cast<float>() - block->center).norm(), block->radius);
  }
}

TEST_F(SnapshotTest, PointsWithoutUsableSourceLoseTheirLiveBit) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  const SE3 camera_from_map = pose();
  const Blocks made = blocks(1, 5, {2}, camera_from_map);
  made.patches->points[1].keyframe = {99};                                               // unknown
  made.patches->points[2].normal = made.patches->points[2].ray_center.unitOrthogonal();  // edge-on
  made.positions->positions[3] =
      (2 * camera_from_map.center() - made.positions->positions[3].cast<double>()).cast<float>();  // behind
  const uint64_t all = made.positions->live;
  const auto block = make_point_block(made.patches, made.positions,
                                      {keyframe_block({{{1}, SE3(), 2}, {{2}, camera_from_map, 2}}, 0b01)});
  EXPECT_EQ(block->live, 0b10001U) << "a removed source keyframe still serves";
  EXPECT_EQ(made.positions->live, all) << "the block received is not touched";
  for (const size_t s : {1U, 2U, 3U}) EXPECT_EQ(block->right[s], Eigen::Vector3f::Zero());
}

TEST_F(SnapshotTest, BlocksOfUnequalLengthEndAtTheShorter) {
  const Blocks longer = blocks(1, 10, {1}, SE3());
  const Blocks shorter = blocks(1, 6, {1}, SE3());
  const auto keyframes = keyframe_block({{{1}, SE3(), 2}});
  EXPECT_EQ(make_point_block(longer.patches, shorter.positions, {keyframes})->count, 6);
  const auto block = make_point_block(shorter.patches, longer.positions, {keyframes});
  EXPECT_EQ(block->count, 6);
  EXPECT_EQ(block->live, 0b111111U);
}

TEST_F(SnapshotTest, FindsEveryLivePointAndNothingElse) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  MapSnapshot snapshot;
  snapshot.keyframe_blocks = {keyframe_block({{{1}, SE3(), 2}})};
  for (uint64_t b = 0; b < 4; ++b) {
    const size_t count = b == 3 ? 10 : kBlockSlots;
    const Blocks made = blocks(1 + 2 * kBlockSlots * b, count, {1}, SE3());
    made.positions->live &= ~uint64_t{0b100};
    snapshot.point_blocks.push_back(make_point_block(made.patches, made.positions, snapshot.keyframe_blocks));
  }
  EXPECT_EQ(snapshot.point_count(), 3U * 63 + 9);
  EXPECT_FALSE(snapshot.find(PointId{0}));
  for (uint64_t id = 1; id < 2 * (3 * kBlockSlots + 10) + 5; ++id) {
    const uint64_t index = (id - 1) / 2;
    const bool exists = id % 2 == 1 && index < 3 * kBlockSlots + 10 && index % kBlockSlots != 2;
    const auto slot = snapshot.find(PointId{id});
    ASSERT_EQ(slot.has_value(), exists) << "id " << id;
    if (exists) {
      EXPECT_EQ(*slot,
                (PointSlot{static_cast<int>(index / kBlockSlots), static_cast<int>(index % kBlockSlots)}));
    }
  }
}

TEST_F(SnapshotTest, FindsLiveKeyframesAndTheNearest) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  MapSnapshot snapshot;
  EXPECT_EQ(snapshot.nearest_keyframe(Eigen::Vector3d::Zero()), nullptr);
  std::vector<KeyframePose> poses;
  for (uint64_t id = 1; id <= kBlockSlots + 20; ++id) poses.push_back({{id}, pose(), 2});
  const auto middle = poses.begin() + kBlockSlots;
  snapshot.keyframe_blocks = {keyframe_block({poses.begin(), middle}, ~uint64_t{0b10}),
                              keyframe_block({middle, poses.end()})};
  EXPECT_EQ(snapshot.keyframe_count(), kBlockSlots + 19U);
  for (const KeyframePose& expected : poses) {
    const KeyframePose* found = snapshot.find(expected.id);
    if (expected.id.value == 2) {
      EXPECT_EQ(found, nullptr);
      EXPECT_NE(snapshot.nearest_keyframe(expected.camera_from_map.center())->id, expected.id);
      continue;
    }
    ASSERT_NE(found, nullptr);
    EXPECT_EQ(*found, expected);
    EXPECT_EQ(snapshot.nearest_keyframe(expected.camera_from_map.center())->id, expected.id);
  }
  EXPECT_EQ(snapshot.find(KeyframeId{kBlockSlots + 21}), nullptr);
}

}  // namespace
}  // namespace cairn
