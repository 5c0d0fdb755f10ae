// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/map/snapshot.h"

namespace cairn::test {

/// The inside of a textured sphere about the origin: wherever a camera in it turns to, there is something to
/// see at a known distance.
class RoundRoom {
 public:
  RoundRoom(uint64_t seed, CameraPtr camera, double radius);

  /// An image with normal noise of `noise` grey values, other noise for another `shot`.
  [[nodiscard]] GrayImagePtr render(const SE3& camera_from_map, double noise, uint64_t shot) const;
  /// The mean of what is seen from half a frame before to half a frame after: `pose_at` of -0.5 to 0.5.
  [[nodiscard]] GrayImagePtr render_exposed(const std::function<SE3(double time)>& pose_at, double noise,
                                            uint64_t shot) const;
  /// Distance from a camera to the wall along a unit ray in the camera's frame.
  [[nodiscard]] double distance(const SE3& camera_from_map, const Eigen::Vector3d& ray) const;
  /// Keyframe 1 at `camera_from_map` with the points that it sees.
  [[nodiscard]] MapSnapshotPtr map_of(const SE3& camera_from_map) const;
  /// A map of one keyframe and no points.
  [[nodiscard]] MapSnapshotPtr empty_map(const SE3& camera_from_map, uint64_t revision = 1) const;

 private:
  [[nodiscard]] double brightness(const Eigen::Vector3d& on_wall) const;
  static constexpr int kSamples = 2;  ///< per axis and pixel
  uint64_t seed_;
  CameraPtr camera_;
  double radius_;
  std::vector<Eigen::Vector3d> rays_;  ///< kSamples^2 per pixel, row-major
};

}  // namespace cairn::test
