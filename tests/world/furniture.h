// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tests/world/random.h"
#include "tests/world/world_builder.h"

namespace cairn {

// Things that stand on desks, in the frame of the builder.

/// Materials of which most of these things are made.
struct Materials {
  TextureRegion dark;
  TextureRegion light;
};

[[nodiscard]] inline BoxSides all_sides(const TextureRegion& region) {
  return {region, region, region};
}

/// A screen of 0.5 m on its foot.
void add_monitor(const Placement& at, const TextureRegion& screen, const Materials& materials,
                 WorldBuilder* world);
void add_keyboard(const Placement& at, const TextureRegion& keys, const Materials& materials,
                  WorldBuilder* world);
/// Adds a mouse on its pad.
void add_mouse(const Placement& at, const TextureRegion& cloth, const Materials& materials,
               WorldBuilder* world);
void add_mug(const Placement& at, const TextureRegion& label, const Materials& materials,
             WorldBuilder* world);
void add_pen_pot(const Placement& at, const TextureRegion& pens, const Materials& materials, Random& random,
                 WorldBuilder* world);

/// Shelves of 2.4 m, full of books, from the floor up to 2.2 m; the middle of their fronts at y = 0.06.
void add_bookcase(double floor, const Materials& materials, Random& random, WorldBuilder* world);

/// A cable that hangs in an arc from one point to another, wandering sideways.
[[nodiscard]] std::vector<Eigen::Vector3d> hanging_cable(const Eigen::Vector3d& from,
                                                         const Eigen::Vector3d& to, double sag,
                                                         Random& random);

}  // namespace cairn
