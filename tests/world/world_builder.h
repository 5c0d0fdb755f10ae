// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tests/world/scenario.h"

namespace cairn {

/// Where a thing stands: the middle of its underside, turned by `yaw` [rad] about Z. Map coordinates.
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

/// Puts a scenario together from simple bodies. Light comes from above, left and the viewer's side.
class WorldBuilder {
 public:
  explicit WorldBuilder(std::string name) { scenario_.name = std::move(name); }

  /// The whole picture, as a region.
  TextureRegion add_texture(const Bitmap& picture);
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

  /// Outlines of what stands on the plane z = 0, for its shadows.
  struct Footprint {
    Eigen::Vector2d centre;
    Eigen::Vector2d half_size;
    double yaw;
  };
  [[nodiscard]] const std::vector<Footprint>& footprints() const { return footprints_; }

  [[nodiscard]] Scenario& scenario() { return scenario_; }

 private:
  void add_footprint(const Placement& at, double half_width, double half_depth);

  Scenario scenario_;
  std::vector<Footprint> footprints_;
};

}  // namespace cairn
