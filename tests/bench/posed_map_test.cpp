// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/posed_map.h"

#include <gtest/gtest.h>

#include "common/image/frame_images.h"
#include "server/mapping/test_scene.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

std::vector<PosedStill> stills_of(const testing::Scene& scene, std::initializer_list<int> steps) {
  std::vector<PosedStill> stills;
  for (const int step : steps) {
    const SE3 pose = testing::Scene::pose(step);
    stills.push_back({Timestamp{step}, scene.render(pose, static_cast<uint64_t>(step)), pose});
  }
  return stills;
}

TEST(PosedMap, ItsPointsLieOnWhatTheStillsShowAndAViewBetweenThemIsFound) {
  const testing::Scene scene(7);
  const auto mapped = map_posed_stills(scene.camera(), stills_of(scene, {0, 2, 4, 6, 8}), MapId{}, 1);
  ASSERT_TRUE(mapped) << mapped.error().message;
  EXPECT_EQ(mapped->poses.size(), 5U);
  const MapSnapshot& map = *mapped->map->snapshot;
  size_t points = 0;
  for (const auto& block : map.point_blocks) points += static_cast<size_t>(std::popcount(block->live));
  EXPECT_GT(points, 300U);

  const SE3 truth = testing::Scene::pose(5);
  FrameImages images;
  images.build_pyramid(scene.render(truth, 50)->view());
  PlaceIndex index;
  index.put(mapped->map);
  const RelocalizationAnswer answer = relocalize(
      index, *scene.camera(), describe_place(images.pyramid, images.all_corners()), RelocOptions());
  ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
  const PlaceCandidate& best = answer.candidates.front();
  const SE3 found = best.camera_from_keyframe * map.find(best.keyframe)->camera_from_map;
  const double depth = static_cast<double>(map.find(best.keyframe)->mean_depth);
  EXPECT_LT((found.center() - truth.center()).norm(), 0.02 * depth);
  EXPECT_LT(so3_log((found * truth.inverse()).rotation()).norm(), 0.01);
}

TEST(PosedMap, WhatHasNothingInCommonMakesNoMap) {
  const testing::Scene scene(7);
  EXPECT_FALSE(map_posed_stills(scene.camera(), stills_of(scene, {3}), MapId{}, 1));
  EXPECT_FALSE(map_posed_stills(scene.camera(), {}, MapId{}, 1));
}

}  // namespace
}  // namespace cairn
