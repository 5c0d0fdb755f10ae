// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tests/world/scenario.h"

namespace cairn {

/// Placement of a thing: the middle of its underside, turned by `yaw` [rad] about Z. Map coordinates.
struct Placement {
  Eigen::Vector3d base = Eigen::Vector3d::Zero();
  double yaw = 0;

  /// A point given in the thing's own axes (x right, y away, z up).
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& local) const;
};

struct BoxSides {
  TextureRegion front;  ///< towards -y
  TextureRegion side;   ///< right, left and back
  TextureRegion top;
};

/// Light without bounces: a sun or lamps far away, and the same from everywhere.
struct Light {
  Eigen::Vector3d to_source = Eigen::Vector3d(-0.35, -0.45, 0.82);
  double ambient = 0.5;
  double direct = 0.62;
  double warmth = 0;  ///< colour temperature: how much brighter red things are than grey ones
  Eigen::Vector2d shadow = Eigen::Vector2d(0.011, 0.0094);  ///< m, where a soft shadow lies from its thing
  bool sunlit = false;                                      ///< the sun throws a window's outline
};
[[nodiscard]] Light light_of(Daytime daytime);

/// Puts a scenario together from simple bodies.
class WorldBuilder {
 public:
  explicit WorldBuilder(std::string name, const Light& light = {}) : light_(light) {
    scenario_.name = std::move(name);
  }
  /// Adds to what there is.
  WorldBuilder(Scenario scenario, const Light& light) : light_(light), scenario_(std::move(scenario)) {}

  /// Begins a frame: what is added from here on stands in it, is part of the place and moves with the body.
  void begin(const SE3& body_from_frame, int place = -1, int body = 0);
  [[nodiscard]] const Light& light() const { return light_; }

  /// Adds a bitmap as a texture. Returns the region that is all of it.
  TextureRegion add_texture(const Bitmap& picture, double warmth = 0);
  /// A material of nearly one grey value.
  TextureRegion add_plain(float value);

  /// A parallelogram; corners as make_face().
  void add_panel(const Eigen::Vector3d& origin, const Eigen::Vector3d& right, const Eigen::Vector3d& up,
                 const TextureRegion& region);
  /// Box without underside. Size: width, depth, height [m].
  void add_box(const Placement& at, const Eigen::Vector3d& size, const BoxSides& sides);
  /// Upright cylinder; the label goes once around.
  void add_cylinder(const Placement& at, double radius, double height, const TextureRegion& label,
                    const TextureRegion& top);
  /// Square tube along a line of points.
  void add_cable(const std::vector<Eigen::Vector3d>& points, double thickness, const TextureRegion& material);
  /// Flat thing lying at its placement's height: width, depth [m].
  void add_sheet(const Placement& at, double width, double depth, const TextureRegion& region);

  /// A flat convex polygon in the plane of a rectangle, cut from its picture. Corners counter-clockwise.
  void add_cut_out(const std::vector<Eigen::Vector3d>& corners, const Eigen::Vector3d& origin,
                   const Eigen::Vector3d& right, const Eigen::Vector3d& up, const TextureRegion& region);

  /// Outlines of what stands on the plane z = 0 of the frame, for its shadows.
  struct Footprint {
    Eigen::Vector2d centre;
    Eigen::Vector2d half_size;
    double yaw;
  };
  [[nodiscard]] const std::vector<Footprint>& footprints() const { return footprints_; }
  /// Darkens the picture of a rectangle of that size [m] about the frame's origin where things throw shadows.
  void paint_shadows(Bitmap* picture, double width, double depth) const;

  [[nodiscard]] Scenario& scenario() { return scenario_; }
  [[nodiscard]] const Scenario& scenario() const { return scenario_; }

 private:
  void add_footprint(const Placement& at, double half_width, double half_depth);

  [[nodiscard]] float brightness_of(const Eigen::Vector3d& normal, const TextureRegion& region) const;

  Light light_;
  SE3 body_from_frame_;
  int place_ = -1;
  int body_ = 0;
  Scenario scenario_;
  std::vector<Footprint> footprints_;
};

}  // namespace cairn
