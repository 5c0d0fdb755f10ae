// SPDX-License-Identifier: Apache-2.0
#include "tests/world/room.h"

#include <array>
#include <cmath>

#include "tests/world/patterns.h"

namespace cairn {
namespace {

/// Distance [m] after which the carpet repeats: not one at which desks stand apart, or else places that look
/// alike would be the same to the pixel.
constexpr double kCarpetPeriod = 8.2;
constexpr int kCarpetPixels = 4096;  ///< 2 mm each

}  // namespace

Bitmap plaster(int size, Random& random) {
  Bitmap wall = pink_noise(size, size, size / 2, 5, 0.02F, random);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) wall.at(x, y) += 0.78F;
  }
  return wall;
}

RoomSurfaces make_surfaces(Random& random, WorldBuilder* world) {
  RoomSurfaces surfaces;
  surfaces.floor = world->add_texture(carpet(kCarpetPixels, kCarpetPixels, random), -0.3);
  surfaces.wall = world->add_texture(plaster(256, random), 0.2);
  Bitmap tile(128, 128, 0.7F);
  tile.fill_rectangle(0, 0, 3, 127, 0.5F);
  tile.fill_rectangle(0, 0, 127, 3, 0.5F);
  surfaces.ceiling = world->add_texture(tile);
  return surfaces;
}

void add_room(const Eigen::Vector3d& low, const Eigen::Vector3d& high, const RoomSurfaces& surfaces,
              WorldBuilder* world) {
  const Eigen::Vector3d size = high - low;
  TextureRegion floor = surfaces.floor;
  floor.width *= size.x() / kCarpetPeriod;
  floor.height *= size.y() / kCarpetPeriod;
  world->add_panel(low, {size.x(), 0, 0}, {0, size.y(), 0}, floor);
  TextureRegion ceiling = surfaces.ceiling;
  ceiling.width *= std::round(size.x() / 0.6);
  ceiling.height *= std::round(size.y() / 0.6);
  world->add_panel({low.x(), high.y(), high.z()}, {size.x(), 0, 0}, {0, -size.y(), 0}, ceiling);
  const std::array<Eigen::Vector2d, 4> corners = {Eigen::Vector2d(low.x(), high.y()), high.head<2>(),
                                                  Eigen::Vector2d(high.x(), low.y()), low.head<2>()};
  for (size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d along = corners[(i + 1) % corners.size()] - corners[i];
    TextureRegion wall = surfaces.wall;
    wall.width *= along.norm() / 2;
    world->add_panel({corners[i].x(), corners[i].y(), low.z()}, {along.x(), along.y(), 0}, {0, 0, size.z()},
                     wall);
  }
}

}  // namespace cairn
