// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/map/snapshot.h"

/// A small world with exact truth for the tests of the map maker: two textured planes, one before part of the
/// other.
namespace cairn::testing {

class Scene {
 public:
  explicit Scene(uint64_t seed);
  /// A scene with another board before the same back: it has an image on its left `share` and is plain
  /// elsewhere.
  Scene(uint64_t seed, uint64_t board_seed, double share);

  /// The same scene as seen by another camera.
  Scene(uint64_t seed, CameraPtr camera);

  static constexpr double kBackDepth = 1.2;   ///< [m] of the plane behind, z in the world
  static constexpr double kFrontDepth = 0.9;  ///< [m] of the board

  [[nodiscard]] CameraPtr camera() const { return camera_; }
  /// Renders what a camera sees, 2x2 samples per pixel, with Gaussian-like noise of about 1.5 grey levels
  /// that depends on `frame`.
  [[nodiscard]] GrayImagePtr render(const SE3& camera_from_world, uint64_t frame) const;
  /// Renders the view at a step, with its number as `frame`; once, then it is kept. Any thread.
  [[nodiscard]] GrayImagePtr view(int step) const;
  /// Point at which the ray through a pixel meets the scene, world frame.
  [[nodiscard]] Eigen::Vector3d hit(const SE3& camera_from_world, const Eigen::Vector2d& pixel) const;
  /// Whether nothing stands between a camera and a point of the scene.
  [[nodiscard]] bool sees(const SE3& camera_from_world, const Eigen::Vector3d& point) const;
  /// A camera moving sideways and turning a little, by steps of about 4 % of the depth.
  [[nodiscard]] static SE3 pose(int step);

 private:
  struct Hit {
    Eigen::Vector3d point;
    int plane = 0;
  };
  [[nodiscard]] Hit trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;
  [[nodiscard]] float texture(const Hit& hit) const;

  /// What copies of a scene share: the ray of each sample of an image, and images that have been rendered.
  struct Views {
    std::once_flag rays_made;
    std::vector<Eigen::Vector3d> rays;
    std::mutex mutex;
    std::map<int, GrayImagePtr> of_step;
  };
  [[nodiscard]] const std::vector<Eigen::Vector3d>& rays() const;

  CameraPtr camera_;
  std::shared_ptr<Views> views_ = std::make_shared<Views>();  ///< a copy sees the same
  std::array<std::vector<float>, 2> textures_;
};

constexpr int kSecondStep = 2;  ///< of Scene::pose(): the second view of the start
/// Similarity from a map to the world of the scene, by its first two keyframes, of steps 0 and kSecondStep.
[[nodiscard]] Similarity3 world_from_map(const MapSnapshot& s);

}  // namespace cairn::testing
