// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
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
  int body = 0;          ///< index into Scenario::bodies; corners and axes are in its coordinates
  int place = -1;        ///< index into Scenario::places that it is a part of, -1 none
};

/// Faces that move together: fixed between stations, gliding from one to the next.
struct Body {
  struct Glide {
    double begin = 0;  ///< s on the clock of the route
    double end = 0;
    SE3 map_from_body;  ///< from `end` on
  };
  SE3 map_from_body;  ///< at first
  std::vector<Glide> glides;

  [[nodiscard]] SE3 at(double route_seconds) const;
};

/// A part of the world that deserves a map of its own.
struct Place {
  std::string name;
  int body = 0;  ///< what it moves with
  SE3 body_from_place;
};

enum class PhaseKind : uint8_t {
  kMap,    ///< the wearer makes a map of the place
  kWalk,   ///< on the way; the place is where to
  kVisit,  ///< the wearer comes back to the place, or to one that has no map
};
[[nodiscard]] std::string_view to_string(PhaseKind kind);

/// What the wearer does from `begin` to `end` [s].
struct Phase {
  PhaseKind kind = PhaseKind::kWalk;
  int place = -1;
  double begin = 0;
  double end = 0;
};

enum class Carrier : uint8_t { kHand, kShoulder };
enum class Daytime : uint8_t { kMorning, kLater };
enum class Session : uint8_t { kAll, kMap, kVisit };
/// How the wearer gets from place to place.
enum class Walks : uint8_t {
  kBrisk,  ///< looking ahead, as one who wants to get there
  kDark,   ///< likewise, the camera covered
  kSlow,   ///< the view held on what stands beside the way, as one who wants it on the map
};

/// Which of the worlds of a name.
struct ScenarioOptions {
  uint64_t seed = 1;                    ///< layout, textures, clutter, route
  Carrier carrier = Carrier::kHand;     ///< which of the wearer's cameras
  Daytime daytime = Daytime::kMorning;  ///< light only; geometry and route stay
  Session session = Session::kAll;      ///< which phases
  Walks walks = Walks::kBrisk;
};

/// A part of a texture, in texels.
struct TextureRegion {
  int texture = 0;
  double x0 = 0;
  double y0 = 0;
  double width = 0;
  double height = 0;
  double warmth = 0;  ///< colour, as far as a grey camera tells: -1 blue, 1 red
};

/// The parallelogram origin, origin + right, origin + right + up, origin + up (counter-clockwise seen from
/// the front), the region laid over it with its top left corner at origin + up.
[[nodiscard]] Face make_face(const Eigen::Vector3d& origin, const Eigen::Vector3d& right,
                             const Eigen::Vector3d& up, const TextureRegion& region, float brightness);

/// What lies still over the image, of the image's size: a lens's border, a water mark.
struct Overlay {
  Bitmap grey;
  Bitmap opacity;  ///< 0 the world, 1 the overlay
};

/// A world, the camera in it and the way the camera moves. A value; the renderer only reads it.
struct Scenario {
  std::string name;
  std::vector<Texture> textures;
  std::vector<Face> faces;
  std::vector<Body> bodies = {Body{}};  ///< the first is the map itself
  std::vector<Place> places;
  CameraPtr camera;
  double vignetting = 0;  ///< 0 none, 1 the cos^4 law
  Carrier carrier = Carrier::kHand;
  std::vector<Waypoint> route;  ///< of the camera, one every kWaypointInterval
  std::vector<Phase> phases;    ///< in order, without gaps, on the clock of the route
  bool endless = true;          ///< the route is a loop
  std::vector<Turn> turns;      ///< on top of the route
  double calm = 0;              ///< s from the start in which the hand does not heed a factor on its speed
  std::optional<Overlay> overlay;
};

constexpr double kWaypointInterval = 0.6;  // s at speed 1

struct ScenarioInfo {
  std::string_view name;
  std::string_view description;
};
[[nodiscard]] const std::vector<ScenarioInfo>& scenario_list();

/// The named scenario. An unknown name is kUsage and the message lists the scenarios there are.
[[nodiscard]] Result<Scenario> make_scenario(std::string_view name, const ScenarioOptions& options);

}  // namespace cairn
