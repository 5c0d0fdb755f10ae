// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/snapshot_builder.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr double kFocal = 500;
constexpr double kDepth = 2;

/// Two keyframes and 150 points at one depth: three point blocks. The first two blocks come from keyframe 1,
/// the last from 2.
class SnapshotBuilderTest : public ::testing::Test {
 protected:
  SnapshotBuilderTest() {
    CameraParameters p;
    p.width = 640;
    p.height = 480;
    p.values = {kFocal, kFocal, 319.5, 239.5};
    const CameraPtr camera = *make_camera(p);
    for (int i = 0; i < 2; ++i) {
      MapKeyframe k;
      k.camera = camera;
      k.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {-0.2 * i, 0, 0});
      k.mean_depth = kDepth;
      map_.add_keyframe(std::move(k));
    }
    for (int i = 0; i < 150; ++i) add_point(i < 2 * kBlockSlots ? 1 : 2, {0.002 * i, 0.001 * i, kDepth});
  }

  PointId add_point(uint64_t source_keyframe, const Eigen::Vector3d& position) {
    PointSource source;
    source.keyframe = KeyframeId{source_keyframe};
    const Eigen::Vector3d ray = (map_.keyframe(source.keyframe).camera_from_map * position).normalized();
    source.ray_center = ray.cast<float>();
    source.ray_right = (ray + Eigen::Vector3d(1 / kFocal, 0, 0)).normalized().cast<float>();
    source.ray_down = (ray + Eigen::Vector3d(0, 1 / kFocal, 0)).normalized().cast<float>();
    source.normal = -source.ray_center;
    const PointId id = map_.add_point(source, position);
    for (uint64_t k = 1; k <= 2; ++k) map_.add_measurement(KeyframeId{k}, {id, 0, {1, 1}});
    return id;
  }

  MapState map_;
  SnapshotBuilder builder_{MapId{}, "test", Epoch{7}, PublicationOptions()};
};

TEST_F(SnapshotBuilderTest, HoldsTheMap) {
  map_.remove_point(PointId{5});
  const auto s = builder_.build(map_);
  EXPECT_EQ(s->revision, Revision{1});
  EXPECT_EQ(s->epoch, Epoch{7});
  EXPECT_EQ(s->name, "test");
  EXPECT_EQ(s->point_count(), 149U);
  EXPECT_EQ(s->keyframe_count(), 2U);
  EXPECT_FALSE(s->find(PointId{5}));
  for (const MapPoint& p : map_.points()) {
    if (!p.live) continue;
    const auto slot = s->find(p.id);
    ASSERT_TRUE(slot);
    EXPECT_EQ(static_cast<uint64_t>(slot->block), (p.id.value - 1) / kBlockSlots);
    EXPECT_EQ(static_cast<uint64_t>(slot->slot), (p.id.value - 1) % kBlockSlots);
    EXPECT_LT((s->point_blocks[static_cast<size_t>(slot->block)]->position(slot->slot) - p.position).norm(),
              1e-6);
  }
}

TEST_F(SnapshotBuilderTest, NothingChangedNothingNew) {
  const auto a = builder_.build(map_);
  EXPECT_EQ(builder_.build(map_), a);
}

TEST_F(SnapshotBuilderTest, OnlyWhatMovedVisiblyIsNew) {
  const auto a = builder_.build(map_);
  const double pixel = kDepth / kFocal;
  map_.point(PointId{70}).position.x() += 0.1 * pixel;
  EXPECT_EQ(builder_.build(map_), a);
  // Moves add up against what was published, not against the last call; depth counts like the sideways
  // directions.
  map_.point(PointId{70}).position.z() += 0.25 * pixel;
  const auto b = builder_.build(map_);
  EXPECT_EQ(b->revision, Revision{2});
  EXPECT_EQ(b->point_blocks[0], a->point_blocks[0]);
  EXPECT_EQ(b->point_blocks[2], a->point_blocks[2]);
  EXPECT_NE(b->point_blocks[1]->positions, a->point_blocks[1]->positions);
  EXPECT_GT(b->point_blocks[1]->positions->version, a->point_blocks[1]->positions->version);
  EXPECT_EQ(b->point_blocks[1]->patches, a->point_blocks[1]->patches);
  EXPECT_EQ(b->keyframe_blocks, a->keyframe_blocks);
}

TEST_F(SnapshotBuilderTest, ANewPointCompletesTheLastBlock) {
  const auto a = builder_.build(map_);
  const PointId id = add_point(2, {0.1, 0.1, kDepth});
  const auto b = builder_.build(map_);
  EXPECT_EQ(b->point_blocks[0], a->point_blocks[0]);
  EXPECT_EQ(b->point_blocks[1], a->point_blocks[1]);
  EXPECT_NE(b->point_blocks[2]->patches, a->point_blocks[2]->patches);
  EXPECT_GT(b->point_blocks[2]->patches->version, a->point_blocks[2]->patches->version);
  EXPECT_TRUE(b->find(id));
  EXPECT_FALSE(a->find(id));
}

TEST_F(SnapshotBuilderTest, ARemovedPointLosesItsBitAndKeepsItsSlot) {
  const auto a = builder_.build(map_);
  map_.remove_point(PointId{3});
  const auto b = builder_.build(map_);
  EXPECT_EQ(b->point_blocks[0]->patches, a->point_blocks[0]->patches);
  EXPECT_EQ(b->point_blocks[0]->positions->positions.size(), 64U);
  EXPECT_FALSE(b->find(PointId{3}));
  EXPECT_TRUE(b->find(PointId{4}));
  EXPECT_EQ(b->point_blocks[1], a->point_blocks[1]);
}

TEST_F(SnapshotBuilderTest, AMovedKeyframeRenewsThePatchVectorsOfItsPoints) {
  const auto a = builder_.build(map_);
  MapKeyframe& k = map_.keyframe(KeyframeId{2});
  k.camera_from_map = SE3(so3_exp({0, 0, 0.01}), {0, 0, 0}) * k.camera_from_map;
  const auto b = builder_.build(map_);
  EXPECT_NE(b->keyframe_blocks[0], a->keyframe_blocks[0]);
  EXPECT_EQ(b->point_blocks[0], a->point_blocks[0]);
  EXPECT_EQ(b->point_blocks[1], a->point_blocks[1]);
  EXPECT_NE(b->point_blocks[2], a->point_blocks[2]);
  EXPECT_EQ(b->point_blocks[2]->patches, a->point_blocks[2]->patches);
  EXPECT_EQ(b->point_blocks[2]->positions, a->point_blocks[2]->positions);
}

TEST_F(SnapshotBuilderTest, VisibilityIsThatOfTheObservers) {
  const auto s = builder_.build(map_);
  const MapPoint& p = map_.points()[0];
  const PointVisibility& v = s->point_blocks[0]->visibility(0);
  const Eigen::Vector3d to_first = map_.keyframe(KeyframeId{1}).camera_from_map.center() - p.position;
  const Eigen::Vector3d to_second = map_.keyframe(KeyframeId{2}).camera_from_map.center() - p.position;
  const Eigen::Vector3d mean = (to_first.normalized() + to_second.normalized()).normalized();
  EXPECT_LT((v.mean_direction.cast<double>() - mean).norm(), 1e-6);
  EXPECT_NEAR(v.min_cosine, mean.dot(to_first.normalized()), 1e-6);
  EXPECT_NEAR(v.min_distance, std::min(to_first.norm(), to_second.norm()), 1e-6);
  EXPECT_NEAR(v.max_distance, std::max(to_first.norm(), to_second.norm()), 1e-6);
}

}  // namespace
}  // namespace cairn
