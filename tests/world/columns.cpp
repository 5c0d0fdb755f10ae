// SPDX-License-Identifier: Apache-2.0
#include "tests/world/columns.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kLength = 0.40;  // m, along x
constexpr double kDepth = 0.26;
constexpr double kBase = 0.045;
constexpr double kColumn = 0.17;  // height
constexpr double kRadius = 0.016;
constexpr int kAlong = 6;
constexpr int kAcross = 4;
constexpr int kStations = 16;
constexpr double kDistance = 1.5;
constexpr double kFocal = 1520;  // px: as one photographs a model

enum Stream : uint64_t { kStone = 0xC01 };

Bitmap fluted(Random& random) {
  Bitmap shaft = rough(256, 256, 0.6F, 0.03F, 26, random);
  for (int x = 0; x < 256; ++x) {
    const auto groove = static_cast<float>(0.8 + 0.2 * std::cos(2 * std::numbers::pi * x / 16));
    for (int y = 0; y < 256; ++y) shaft.at(x, y) *= groove;
  }
  shaft.fill_rectangle(0, 0, 255, 10, 0.68F);  // capital
  shaft.fill_rectangle(0, 11, 255, 13, 0.3F);
  return shaft;
}

/// The frieze over one gap between columns, which repeats.
Bitmap frieze(Random& random) {
  Bitmap piece = rough(128, 64, 0.6F, 0.03F, 2, random);
  for (const float x : {4.0F, 14.0F, 24.0F}) piece.fill_rectangle(x, 8, x + 5, 50, 0.38F);
  piece.fill_disc(80, 30, 16, 0.45F);
  piece.fill_disc(80, 30, 9, 0.66F);
  piece.fill_rectangle(0, 56, 127, 58, 0.35F);
  return piece;
}

}  // namespace

Scenario make_columns(const ScenarioOptions& options) {
  WorldBuilder world("columns", light_of(options.daytime));
  world.scenario().places.push_back({"temple", 0, SE3()});
  world.begin(SE3(), 0);
  Random random(options.seed, kStone);
  const TextureRegion plain = world.add_texture(rough(256, 256, 0.62F, 0.03F, 0, random));
  const BoxSides block = all_sides(plain);
  const TextureRegion shaft = world.add_texture(fluted(random));
  for (int step = 0; step < 3; ++step) {
    const double wider = 0.03 * (2 - step);
    world.add_box({{0, 0, kBase / 3 * step}, 0}, {kLength + wider, kDepth + wider, kBase / 3}, block);
  }
  world.add_box({{0, 0, kBase}, 0}, {kLength - 0.16, kDepth - 0.13, kColumn}, block);
  for (int i = 0; i < kAlong; ++i) {
    for (int j = 0; j < kAcross; ++j) {
      if (i > 0 && i + 1 < kAlong && j > 0 && j + 1 < kAcross) continue;
      const double x = (kLength - 0.05) * (static_cast<double>(i) / (kAlong - 1) - 0.5);
      const double y = (kDepth - 0.05) * (static_cast<double>(j) / (kAcross - 1) - 0.5);
      world.add_cylinder({{x, y, kBase}, 0}, kRadius, kColumn, shaft, plain);
    }
  }
  TextureRegion front = world.add_texture(frieze(random));
  TextureRegion side = front;
  front.width *= kAlong - 1;
  side.width *= kAcross - 1;
  world.add_box({{0, 0, kBase + kColumn}, 0}, {kLength, kDepth, 0.035}, {front, side, plain});
  world.add_box({{0, 0, kBase + kColumn + 0.035}, 0}, {kLength - 0.05, kDepth - 0.08, 0.025}, block);
  // What tells front from rear: without it the temple would be the same from either side.
  world.add_panel({-0.03, -(kDepth - 0.13) / 2 - 0.001, kBase}, {0.06, 0, 0}, {0, 0, 0.12},
                  world.add_texture(rough(64, 128, 0.15F, 0.03F, 10, random)));
  world.add_box({{0.13, -kDepth / 2 - 0.06, 0}, 0.3}, {0.07, 0.05, 0.06},
                all_sides(world.add_texture(rough(128, 128, 0.5F, 0.12F, 60, random))));
  std::vector<Waypoint> route;
  for (int i = 0; i < kStations; ++i) {
    const double angle = 2 * std::numbers::pi * i / kStations;
    route.push_back(
        {{kDistance * std::sin(angle), -kDistance * std::cos(angle), 0.55}, {0, 0, kBase + kColumn / 2}});
  }
  RouteBuilder builder;
  builder.add(PhaseKind::kMap, 0, route);
  std::move(builder).close(options.carrier, &world.scenario());
  const auto camera =
      make_camera({CameraModel::kPinholeRadtan, 640, 480, {kFocal, kFocal, 320, 240, 0, 0, 0, 0, 0}});
  if (!camera) throw std::logic_error(camera.error().message);
  world.scenario().camera = *camera;
  return std::move(world.scenario());
}

}  // namespace cairn
