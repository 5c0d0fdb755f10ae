// SPDX-License-Identifier: Apache-2.0
#include "tests/world/shoulder.h"

#include <array>
#include <cmath>
#include <numbers>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/room.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kFloor = -1.45;
constexpr double kTop = -0.5;  // of the stand
constexpr double kCeiling = 1.25;
constexpr double kHalfRoom = 4.2;
constexpr double kRadius = 2;  // of the wearer's way
constexpr double kThin = 0.002;
constexpr int kStations = 21;

enum Stream : uint64_t { kSurfaces = 0x5401, kStand, kThings, kWalls };

/// Adds an image that is nowhere else.
TextureRegion add_picture(Random& random, WorldBuilder* world) {
  switch (random.integer(0, 3)) {
    case 0:
      return world->add_texture(cover(256, 256, random));
    case 1:
      return world->add_texture(dead_leaves(256, 256, random));
    case 2:
      return world->add_texture(printed_page(256, 256, random));
    default:
      return world->add_texture(code_screen(256, 256, random.integer(0, 1) == 0, random));
  }
}

/// Frame turned about z by `side` quarter turns: a wall is built in it as somebody sees it who looks along y.
SE3 facing(int side) {
  return {so3_exp({0, 0, side * std::numbers::pi / 2}), Eigen::Vector3d::Zero()};
}

void add_room_of_pictures(uint64_t seed, WorldBuilder* world) {
  Random surfaces(seed, kSurfaces);
  world->begin(SE3());
  TextureRegion floor = world->add_texture(carpet(1024, 1024, surfaces));
  floor.width *= 4;
  floor.height *= 4;
  TextureRegion wall = world->add_texture(plaster(256, surfaces), 0.2);
  Bitmap tile(128, 128, 0.7F);
  tile.fill_rectangle(0, 0, 3, 127, 0.5F);
  tile.fill_rectangle(0, 0, 127, 3, 0.5F);
  add_room({-kHalfRoom, -kHalfRoom, kFloor}, {kHalfRoom, kHalfRoom, kCeiling},
           {floor, wall, world->add_texture(tile)}, world);
  Random random(seed, kWalls);
  for (int side = 0; side < 4; ++side) {
    world->begin(facing(side));
    for (double x = -3.7; x < 3.2; x += random.uniform(0.75, 1.05)) {
      const double size = random.uniform(0.4, 0.65);
      world->add_panel({x, kHalfRoom - kThin, random.uniform(-0.55, 0.3)}, {size, 0, 0}, {0, 0, size},
                       add_picture(random, world));
    }
    // Low things along the wall.
    for (double x = -3.4; x < 3.4; x += random.uniform(0.9, 1.5)) {
      world->add_box({{x, kHalfRoom - 0.4, kFloor}, random.uniform(-0.2, 0.2)},
                     {random.uniform(0.4, 0.7), 0.4, random.uniform(0.4, 0.7)},
                     all_sides(add_picture(random, world)));
    }
  }
}

void add_stand(uint64_t seed, WorldBuilder* world) {
  world->begin(SE3(), 0);
  Random random(seed, kStand);
  const TextureRegion board = world->add_texture(wood(512, 256, random), 0.4);
  world->add_box({{0, 0, kFloor}, 0}, {1.1, 1.1, kTop - kFloor}, all_sides(board));
  world->add_box({{0, 0, kTop}, 0}, {0.5, 0.5, 0.9}, all_sides(board));
  for (int side = 0; side < 4; ++side) {
    world->begin(facing(side), 0);
    // Seen from the wearer's side of it: the front of a panel is towards -y.
    world->add_panel({-0.5, -0.55 - kThin, kFloor + 0.1}, {1, 0, 0}, {0, 0, 0.8}, add_picture(random, world));
    world->add_panel({-0.24, -0.25 - kThin, kTop + 0.02}, {0.48, 0, 0}, {0, 0, 0.42},
                     add_picture(random, world));
    world->add_panel({-0.24, -0.25 - kThin, kTop + 0.46}, {0.48, 0, 0}, {0, 0, 0.42},
                     add_picture(random, world));
  }
  world->begin(SE3(), 0);
  Random things(seed, kThings);
  for (int i = 0; i < 14; ++i) {
    const double angle = 2 * std::numbers::pi * i / 14;
    const double out = 0.41 / std::max(std::abs(std::cos(angle)), std::abs(std::sin(angle)));
    const TextureRegion label = world->add_texture(cover(128, 128, things), things.uniform(-0.8, 0.8));
    world->add_box({{out * std::cos(angle), out * std::sin(angle), kTop}, things.uniform(0, 1.5)},
                   {things.uniform(0.07, 0.14), things.uniform(0.06, 0.12), things.uniform(0.08, 0.3)},
                   all_sides(label));
  }
}

}  // namespace

Scenario make_shoulder(const ScenarioOptions& options) {
  WorldBuilder world("shoulder", light_of(options.daytime));
  world.scenario().places.push_back({"stand", 0, SE3()});
  add_room_of_pictures(options.seed, &world);
  add_stand(options.seed, &world);
  std::vector<Waypoint> route;
  for (int i = 0; i < kStations; ++i) {
    const double angle = 2 * std::numbers::pi * i / kStations;
    route.push_back({{-kRadius * std::cos(angle), -kRadius * std::sin(angle), 0}, Eigen::Vector3d::Zero()});
  }
  RouteBuilder builder;
  builder.add(PhaseKind::kMap, 0, route);
  std::move(builder).close(options.carrier, &world.scenario());
  return std::move(world.scenario());
}

}  // namespace cairn
