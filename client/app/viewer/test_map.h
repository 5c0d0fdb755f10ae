// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "client/tracking/tracker.h"
#include "common/geometry/camera.h"
#include "common/map/snapshot.h"

/// A map for tests of the live view.
namespace cairn::testing {

inline constexpr MapId kMap{{7}};
inline constexpr Epoch kEpoch{3};
inline constexpr KeyframeId kKeyframe{1};
inline constexpr double kDepth = 2;

inline CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, 0, 0, 0, 0, 0}});
}

inline SE3 keyframe_pose() {
  return SE3::exp((Vector6d() << 0.1, -0.2, 0.3, 0.05, 0.1, -0.02).finished());
}

/// One keyframe, and points on a plane before the camera of the frame, every 32 px.
struct TestMap {
  explicit TestMap(const Camera& camera, const SE3& camera_from_map) {
    auto keyframes = std::make_shared<KeyframeBlock>();
    keyframes->keyframes = {{kKeyframe, keyframe_pose(), 2}};
    keyframes->live = 1;
    snapshot = std::make_shared<MapSnapshot>();
    snapshot->map = kMap;
    snapshot->epoch = kEpoch;
    snapshot->keyframe_blocks = {keyframes};
    auto patches = std::make_shared<PatchBlock>();
    auto positions = std::make_shared<PositionBlock>();
    for (int i = 0; i < 64; ++i) {
      const Eigen::Vector2d pixel(200 + 32 * (i % 8), 120 + 32 * (i / 8));
      const auto ray = [&](double dx, double dy) -> Eigen::Vector3f {
        return camera.unproject(pixel + Eigen::Vector2d(dx, dy)).cast<float>();
      };
      PointSource source;
      source.id = {static_cast<uint64_t>(i + 1)};
      source.keyframe = kKeyframe;
      source.ray_center = ray(0, 0);
      source.ray_right = ray(1, 0);
      source.ray_down = ray(0, 1);
      patches->points.push_back(source);
      const Eigen::Vector3d ray_to = camera.unproject(pixel);
      positions->positions.push_back(
          (camera_from_map.inverse() * Eigen::Vector3d(kDepth / ray_to.z() * ray_to)).cast<float>());
      positions->live |= uint64_t{1} << i;
      tracked.push_back({source.id, 0, true, pixel.cast<float>()});
    }
    positions->visibility.resize(64);
    snapshot->point_blocks = {make_point_block(patches, positions, snapshot->keyframe_blocks)};
  }
  std::shared_ptr<MapSnapshot> snapshot;
  std::vector<TrackedPoint> tracked;
};

}  // namespace cairn::testing
