// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/map/snapshot.h"

namespace cairn::test {

/// A textured plane Z = 0 seen by an exact camera, and its map made without a map maker: for laws about the
/// tracker alone.
class PlaneScene {
 public:
  PlaneScene(uint64_t seed, CameraPtr camera);

  [[nodiscard]] GrayImagePtr render(const SE3& camera_from_map) const;
  /// Keyframe 1 at `camera_from_map` with a point, at its exact place, for every candidate corner of every
  /// level.
  [[nodiscard]] MapSnapshotPtr make_map(const SE3& camera_from_map) const;

 private:
  [[nodiscard]] double brightness(double x, double y) const;
  static constexpr int kTexels = 1024;
  static constexpr double kTexelsPerMetre = 400;
  static constexpr int kSamples = 2;  ///< per axis and pixel: box anti-aliasing
  CameraPtr camera_;
  std::vector<float> texture_;
  std::vector<Eigen::Vector3d> rays_;  ///< kSamples^2 per pixel, row-major
};

}  // namespace cairn::test
