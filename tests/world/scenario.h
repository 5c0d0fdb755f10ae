// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/camera.h"
#include "tests/world/motion.h"
#include "tests/world/texture.h"

namespace cairn {

constexpr int kMaxFaceCorners = 16;

/// A flat convex textured polygon, seen from its front only. Map coordinates, metres.
struct Face {
  std::vector<Eigen::Vector3d> corners;  ///< 3 to kMaxFaceCorners, counter-clockwise seen from the front
  Eigen::Vector3d normal;                ///< unit, towards the front
  int texture = 0;                       ///< index into Scenario::textures
  /// Texel coordinates of a point of the face at level 0: u_axis.dot(p) + u_offset, likewise v; centre of
  /// texel 0 at 0.5.
  Eigen::Vector3d u_axis = Eigen::Vector3d::Zero();
  Eigen::Vector3d v_axis = Eigen::Vector3d::Zero();
  double u_offset = 0;
  double v_offset = 0;
  float brightness = 1;  ///< grey value of a white texel = 255 * brightness * gain
};

/// A part of a texture, in texels.
struct TextureRegion {
  int texture = 0;
  double x0 = 0;
  double y0 = 0;
  double width = 0;
  double height = 0;
};

/// The parallelogram origin, origin + right, origin + right + up, origin + up (counter-clockwise seen from
/// the front), the region laid over it with its top left corner at origin + up.
[[nodiscard]] Face make_face(const Eigen::Vector3d& origin, const Eigen::Vector3d& right,
                             const Eigen::Vector3d& up, const TextureRegion& region, float brightness);

/// A world, the camera in it and the way the camera moves. A value; the renderer only reads it.
struct Scenario {
  std::string name;
  std::vector<Texture> textures;
  std::vector<Face> faces;
  CameraPtr camera;
  double vignetting = 0;        ///< 0 none, 1 the cos^4 law
  std::vector<Waypoint> route;  ///< of the hand that holds the camera
};

struct ScenarioInfo {
  std::string_view name;
  std::string_view description;
};
[[nodiscard]] const std::vector<ScenarioInfo>& scenario_list();

/// The named scenario; the seed decides textures, clutter and route. An unknown name is kUsage and the
/// message lists the scenarios there are.
[[nodiscard]] Result<Scenario> make_scenario(std::string_view name, uint64_t seed);

}  // namespace cairn
