// SPDX-License-Identifier: Apache-2.0
#include "tests/world/furniture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/world/patterns.h"

namespace cairn {

void add_monitor(const Placement& at, const TextureRegion& screen, const Materials& materials,
                 WorldBuilder* world) {
  const BoxSides dark = all_sides(materials.dark);
  world->add_box(at, {0.22, 0.16, 0.012}, dark);
  world->add_box({at * Eigen::Vector3d(0, 0.05, 0.012), at.yaw}, {0.05, 0.03, 0.14}, dark);
  const Eigen::Vector3d size(0.50, 0.035, 0.31);
  world->add_box({at * Eigen::Vector3d(0, 0.02, 0.13), at.yaw}, size, dark);
  const Eigen::Vector3d corner(-0.237, 0.02 - size.y() / 2 - 0.001, 0.13 + 0.025);
  const Eigen::Vector3d origin = at * corner;
  world->add_panel(origin, at * Eigen::Vector3d(corner + Eigen::Vector3d(0.474, 0, 0)) - origin,
                   {0, 0, 0.272}, screen);
}

void add_keyboard(const Placement& at, const TextureRegion& keys, const Materials& materials,
                  WorldBuilder* world) {
  world->add_box(at, {0.44, 0.135, 0.022}, {materials.dark, materials.dark, keys});
}

void add_mouse(const Placement& at, const TextureRegion& cloth, const Materials& materials,
               WorldBuilder* world) {
  constexpr double kPad = 0.003;
  world->add_box(at, {0.21, 0.18, kPad}, {materials.dark, materials.dark, cloth});
  world->add_box({at * Eigen::Vector3d(0.01, 0.02, kPad), at.yaw + 0.2}, {0.058, 0.1, 0.03},
                 {materials.dark, materials.light, materials.light});
}

void add_mug(const Placement& at, const TextureRegion& label, const Materials& materials,
             WorldBuilder* world) {
  world->add_cylinder(at, 0.041, 0.095, label, materials.dark);
  world->add_box({at * Eigen::Vector3d(0.055, 0, 0.022), at.yaw}, {0.028, 0.012, 0.052},
                 all_sides(materials.light));
}

void add_pen_pot(const Placement& at, const TextureRegion& pens, const Materials& materials, Random& random,
                 WorldBuilder* world) {
  world->add_cylinder(at, 0.04, 0.10, materials.dark, materials.dark);
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d foot =
        at * Eigen::Vector3d(random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02), 0.07);
    const Eigen::Vector3d lean(random.uniform(-0.03, 0.03), random.uniform(-0.03, 0.03), 0.09);
    world->add_cable({foot, foot + lean}, 0.008, i % 2 == 0 ? materials.light : pens);
  }
}

void add_bookcase(double floor, const Materials& materials, Random& random, WorldBuilder* world) {
  const BoxSides shelf = all_sides(world->add_texture(wood(256, 128, random), 0.5));
  for (const double x : {-1.2, 0.0, 1.2}) world->add_box({{x, 0.22, floor}, 0}, {0.03, 0.32, 2.2}, shelf);
  std::array<TextureRegion, 24> spines;
  for (TextureRegion& back : spines) {
    back = world->add_texture(spine(64, 256, random), random.uniform(-0.9, 0.9));
  }
  for (int row = 0; row < 5; ++row) {
    const double z = floor + 0.05 + 0.42 * row;
    world->add_box({{0, 0.22, z - 0.03}, 0}, {2.4, 0.32, 0.03}, shelf);
    for (double x = -1.16; x < 1.1;) {
      const double thickness = random.uniform(0.022, 0.05);
      const Eigen::Vector3d size(thickness, 0.2, random.uniform(0.22, 0.33));
      const TextureRegion& back = spines[static_cast<size_t>(random.integer(0, 23))];
      world->add_box({{x + thickness / 2, 0.2, z}, 0}, size, {back, materials.dark, materials.light});
      x += thickness + (random.chance(0.08) ? 0.14 : 0.002);
    }
  }
}

std::vector<Eigen::Vector3d> hanging_cable(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double sag,
                                           Random& random) {
  constexpr int kPieces = 14;
  const double phase = random.uniform(0.0, 6.0);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= kPieces; ++i) {
    const double t = static_cast<double>(i) / kPieces;
    Eigen::Vector3d point = from + t * (to - from);
    point.z() = std::max(point.z() - 4 * sag * t * (1 - t), 0.004);
    point.x() += 0.03 * std::sin(7 * t + phase) * t * (1 - t) * 4;
    points.push_back(point);
  }
  return points;
}

}  // namespace cairn
