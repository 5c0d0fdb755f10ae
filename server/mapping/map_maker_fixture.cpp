// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_maker_fixture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "common/geometry/triangulation.h"
#include "common/geometry/two_view.h"
#include "common/image/corners.h"
#include "common/image/patch.h"
#include "common/image/pyramid.h"

namespace cairn::testing {

std::vector<Trail> make_trails(const Scene& scene, const GrayImage& first, const SE3& first_pose,
                               const SE3& second_pose) {
  CornerList corners;
  detect_fast10(first.view(), 10, &corners);
  std::vector<Candidate> candidates = find_candidates(first.view(), corners);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  candidates.resize(std::min<size_t>(candidates.size(), 500));
  std::mt19937_64 random(1);
  std::vector<Trail> trails;
  for (const Candidate& c : candidates) {
    const Eigen::Vector2d a(c.corner.x, c.corner.y);
    const Eigen::Vector3d point = scene.hit(first_pose, a);
    if (!scene.sees(second_pose, point)) continue;
    Eigen::Vector2d b = *scene.camera()->project(second_pose * point);
    b = {std::round(b.x()), std::round(b.y())};
    if (trails.size() % 10 == 9)
      b += Eigen::Vector2d{static_cast<double>(random() % 21) - 10, static_cast<double>(random() % 21) - 10};
    trails.push_back({TrailId{trails.size() + 1}, a.cast<float>(), b.cast<float>()});
  }
  return trails;
}

SE3 motion_between(const SeedInput& input, const SE3& true_motion) {
  std::vector<PixelMatch> matches;
  for (const Trail& t : input.trails) matches.push_back({t.first.cast<double>(), t.second.cast<double>()});
  const auto motions = find_motions(*input.camera, *input.camera, matches, {});
  if (!motions) {
    ADD_FAILURE() << motions.error().message;
    return {};
  }
  const auto difference = [&true_motion](const SE3& motion) {
    return motion.rotation().angularDistance(true_motion.rotation()) +
           parallax(Eigen::Vector3d::Zero(), motion.translation(), true_motion.translation());
  };
  return *std::min_element(
      motions->b_from_a.begin(), motions->b_from_a.end(),
      [&difference](const SE3& a, const SE3& b) { return difference(a) < difference(b); });
}

KeyframeInput make_offer(const Scene& scene, const MapSnapshot& s, int step) {
  return make_offer(scene, s, step, scene.view(step));
}

KeyframeInput make_offer(const Scene& scene, const MapSnapshot& s, int step, GrayImagePtr image) {
  KeyframeInput offer;
  offer.camera = scene.camera();
  offer.time = Timestamp{step};
  offer.image = std::move(image);
  const SE3 camera_from_map = world_from_map(s).inverse().transform_camera(Scene::pose(step));
  const KeyframePose* reference = s.nearest_keyframe(camera_from_map.center());
  offer.reference = reference->id;
  offer.camera_from_reference = camera_from_map * reference->camera_from_map.inverse();
  Pyramid pyramid;
  pyramid.build(offer.image->view());
  std::array<CornerList, kPyramidLevels> corners;
  for (int l = 0; l < kPyramidLevels; ++l) {
    detect_fast10(pyramid.level(l).view(), 10, &corners[static_cast<size_t>(l)]);
  }
  for (const auto& block : s.point_blocks) {
    for (int i = 0; i < block->count; ++i) {
      const PointSource& source = block->source(i);
      if (!s.find(source.id)) continue;
      Matrix23d J;
      const auto pixel = scene.camera()->project(camera_from_map * block->position(i), &J);
      if (!pixel || !scene.camera()->in_image(*pixel, 8)) continue;
      const Matrix23d to_image = J * camera_from_map.rotation_matrix();
      Warp warp;
      warp.col(0) = (to_image * block->right[static_cast<size_t>(i)].cast<double>()).cast<float>();
      warp.col(1) = (to_image * block->down[static_cast<size_t>(i)].cast<double>()).cast<float>();
      const auto level = warp_level(warp);
      PatchTemplate patch;
      if (!level || !make_template(source.pixels, warp, *level, &patch)) continue;
      const Eigen::Vector2f at(to_level(static_cast<float>(pixel->x()), *level),
                               to_level(static_cast<float>(pixel->y()), *level));
      const auto match =
          find_patch(patch, pyramid.level(*level).view(), corners[static_cast<size_t>(*level)], at, 5);
      if (!match) continue;
      offer.measurements.push_back(
          {source.id,
           static_cast<uint8_t>(*level),
           {from_level(match->corner.x, *level), from_level(match->corner.y, *level)}});
    }
  }
  return offer;
}

const Scene& two_planes() {
  static const Scene scene(11);
  return scene;
}

const SeedInput& seed_of_two_planes() {
  static const SeedInput seed = [] {
    const Scene& scene = two_planes();
    SeedInput input;
    input.map_name = "two planes";
    input.epoch = Epoch{1};
    input.camera = scene.camera();
    input.first_image = scene.view(0);
    input.second_image = scene.view(kSecondStep);
    input.trails = make_trails(scene, *input.first_image, Scene::pose(0), Scene::pose(kSecondStep));
    input.second_from_first = motion_between(input, Scene::pose(kSecondStep) * Scene::pose(0).inverse());
    return input;
  }();
  return seed;
}

std::vector<uint8_t> bytes_of(const MapSnapshot& s) {
  std::vector<uint8_t> bytes;
  const auto put = [&bytes](const void* data, size_t size) {
    const auto* begin = static_cast<const uint8_t*>(data);
    bytes.insert(bytes.end(), begin, begin + size);
  };
  for (const auto& block : s.point_blocks) {
    put(&block->positions->live, sizeof(uint64_t));
    for (int i = 0; i < block->count; ++i) {
      put(block->positions->positions[static_cast<size_t>(i)].data(), 3 * sizeof(float));
      put(block->visibility(i).mean_direction.data(), 3 * sizeof(float));
      put(block->source(i).pixels.data(), block->source(i).pixels.size());
    }
  }
  for (const auto& block : s.keyframe_blocks) {
    for (const KeyframePose& k : block->keyframes) {
      put(k.camera_from_map.rotation().coeffs().data(), 4 * sizeof(double));
      put(k.camera_from_map.translation().data(), 3 * sizeof(double));
    }
  }
  return bytes;
}

}  // namespace cairn::testing
