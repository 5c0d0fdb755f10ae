// SPDX-License-Identifier: Apache-2.0
#include "tests/integration/two_views.h"

#include <algorithm>
#include <cmath>

#include "common/image/corners.h"

namespace cairn::testing {
namespace {

constexpr size_t kTrails = 500;

SeedProposal make_seed_of(const Scene& scene, const SE3& first_pose, const SE3& second_pose) {
  SeedProposal seed;
  seed.first_time = {0};
  seed.second_time = {1};
  seed.first_image = scene.render(first_pose, 0);
  seed.second_image = scene.render(second_pose, 1);
  const SE3 step = second_pose * first_pose.inverse();
  seed.second_from_first = SE3(step.rotation(), step.translation().stableNormalized());
  CornerList corners;
  detect_fast10(*seed.first_image, 10, &corners);
  auto candidates = find_candidates(*seed.first_image, corners);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  candidates.resize(std::min(candidates.size(), kTrails));
  for (const Candidate& candidate : candidates) {
    const Eigen::Vector2d first(candidate.corner.x, candidate.corner.y);
    const Eigen::Vector3d point = scene.hit(first_pose, first);
    const auto second = scene.camera()->project(second_pose * point);
    if (!second || !scene.sees(second_pose, point)) continue;
    seed.trails.push_back(
        {TrailId{seed.trails.size() + 1}, first.cast<float>(), second->array().round().cast<float>()});
  }
  return seed;
}

}  // namespace

SeedProposal make_seed(const Scene& scene) {
  return make_seed_of(scene, Scene::pose(kFirstView), Scene::pose(kSecondView));
}

SeedProposal make_seed_without_parallax(const Scene& scene) {
  return make_seed_of(scene, Scene::pose(kFirstView), Scene::pose(kFirstView));
}

Frame make_offer(const Scene& scene, const MapSnapshot& map, int step) {
  const KeyframePose& first = *map.find(KeyframeId{1});
  const KeyframePose& second = *map.find(KeyframeId{2});
  const double map_unit = (first.camera_from_map.center() - second.camera_from_map.center()).norm() /
                          (Scene::pose(kFirstView).center() - Scene::pose(kSecondView).center()).norm();
  const SE3 in_world = Scene::pose(step) * Scene::pose(kSecondView).inverse();
  const SE3 camera_from_second(in_world.rotation(), map_unit * in_world.translation());
  const SE3 camera_from_map = camera_from_second * second.camera_from_map;

  Frame frame;
  frame.image = scene.view(step);
  frame.proposal.map = map.map;
  frame.proposal.epoch = map.epoch;
  frame.proposal.revision = map.revision;
  frame.proposal.reference = second.id;
  frame.proposal.camera_from_reference = camera_from_second;
  for (const auto& block : map.point_blocks) {
    for (int slot = 0; slot < block->count; ++slot) {
      if (!map.find(block->source(slot).id)) continue;
      const auto pixel = scene.camera()->project(camera_from_map * block->position(slot));
      if (!pixel || !scene.camera()->in_image(*pixel, 8)) continue;
      frame.proposal.measurements.push_back({block->source(slot).id, 0, pixel->cast<float>()});
    }
  }
  return frame;
}

}  // namespace cairn::testing
