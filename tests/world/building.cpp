// SPDX-License-Identifier: Apache-2.0
#include "tests/world/building.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <string>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/room.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr int kFloors = 3;
constexpr double kStorey = 3.2;  // m
constexpr double kHeight = 2.8;  // of a room
constexpr double kLength = 9;    // of a floor, from the staircase
constexpr double kDepth = 5;
constexpr double kStairs = 2.5;  // width of the staircase
constexpr double kCounter = 0.9;
constexpr double kWallWidth = 2.4;  // of a place
constexpr double kEye = 1.55;
constexpr float kSunBrightness = 0.95F;  // of a white wall that the low sun shines on: twice that beside it
constexpr double kScale = 1.5;           // of what a wearer does before a place, to a desk's

enum Stream : uint64_t { kSurfaces = 0xB001, kRoute, kThings = 0xB010 };
enum PlaceIndex : int { kReception, kKitchenette, kLanding, kCopier, kLibrary, kPlaces };

class BuildingBuilder {
 public:
  explicit BuildingBuilder(const ScenarioOptions& options)
      : options_(options), world_("building", light_of(options.daytime)) {}

  Scenario build() {
    world_.begin(SE3());
    Random random(options_.seed, kSurfaces);
    materials_ = {world_.add_plain(0.09F), world_.add_plain(0.72F)};
    board_ = world_.add_plain(0.55F);
    surfaces_ = make_surfaces(random, &world_);
    sunlit_ = world_.add_plain(0.98F);
    add_shell();
    add_stairs();
    add_place("reception", 0, 2.3, &BuildingBuilder::furnish_reception);
    add_place("kitchenette", 0, 6.8, &BuildingBuilder::furnish_kitchenette);
    add_place("landing", 1, -kStairs / 2, &BuildingBuilder::furnish_landing);
    add_place("copier", 1, 6.6, &BuildingBuilder::furnish_copier);
    add_place("library", 2, 3.4, &BuildingBuilder::furnish_library);
    Scenario& scenario = world_.scenario();
    make_route(&scenario);
    return std::move(scenario);
  }

 private:
  using Furnish = void (BuildingBuilder::*)(Random& random);

  void add_shell() {
    for (int floor = 0; floor < kFloors; ++floor) {
      const double z = kStorey * floor;
      add_room({0, 0, z}, {kLength, kDepth, z + kHeight}, surfaces_, &world_);
      // Between two places of a floor.
      world_.add_box({{4.7, kDepth - 1, z}, 0}, {0.1, 2, kHeight}, all_sides(materials_.light));
    }
    add_room({-kStairs, 0, 0}, {0, kDepth, kStorey * kFloors}, surfaces_, &world_);
  }

  /// A flight from every floor to the next, up along y, and the landing at its end.
  void add_stairs() {
    constexpr int kSteps = 16;
    constexpr double kBegin = 0.8;
    constexpr double kEnd = kDepth - 1.6;
    constexpr double kTread = (kEnd - kBegin) / kSteps;
    for (int floor = 0; floor + 1 < kFloors; ++floor) {
      for (int step = 0; step < kSteps; ++step) {
        world_.add_box({{-0.6, kBegin + (step + 0.5) * kTread, kStorey * floor}, 0},
                       {1.1, kTread, kStorey * (step + 1) / kSteps}, all_sides(board_));
      }
      world_.add_box({{-kStairs / 2, (kEnd + kDepth) / 2, kStorey * (floor + 1) - 0.2}, 0},
                     {kStairs, kDepth - kEnd, 0.2}, all_sides(board_));
    }
  }

  /// Against the back wall, at `x` along the floor.
  void add_place(const char* name, int floor, double x, Furnish furnish) {
    const int place = static_cast<int>(world_.scenario().places.size());
    const SE3 map_from_place(Eigen::Quaterniond::Identity(),
                             Eigen::Vector3d(x, kDepth - 0.4, kStorey * floor + kCounter));
    world_.scenario().places.push_back({name, 0, map_from_place});
    world_.begin(map_from_place, place);
    // Its piece of the wall, before the shell's.
    TextureRegion wall = surfaces_.wall;
    wall.width *= kWallWidth / 2;
    world_.add_panel({-kWallWidth / 2, 0.3995, -kCounter}, {kWallWidth, 0, 0}, {0, 0, kHeight}, wall);
    Random random(options_.seed, kThings + static_cast<uint64_t>(place));
    (this->*furnish)(random);
  }

  static Placement about(double x, double y, double z, double degrees, Random& random) {
    return {{x + random.uniform(-0.03, 0.03), y + random.uniform(-0.02, 0.02), z},
            (degrees + random.uniform(-8.0, 8.0)) * std::numbers::pi / 180};
  }

  /// Adds the counter, with the shadows of what stands on it: to be called when all that has been added.
  void add_counter(double width, double depth, Random& random) {
    Bitmap picture = wood(1024, 512, random);
    world_.paint_shadows(&picture, width, depth);
    const float sunspot = random.uniform(0.2F, 0.8F);  // drawn in any light
    if (world_.light().sunlit) {
      picture.shade_rectangle(sunspot * 1024, 330, 150, 120, 0.4F, 5, -0.5F);
      picture.clamp();
    }
    const TextureRegion top = world_.add_texture(picture, 0.5);
    world_.add_panel({-width / 2, -depth / 2, 0}, {width, 0, 0}, {0, depth, 0}, top);
    Bitmap doors(512, 256, 0.6F);
    for (float x = 0; x < 512; x += 128) doors.fill_rectangle(x, 0, x + 3, 255, 0.3F);
    world_.add_box({{0, 0, -kCounter}, 0}, {width - 0.02, depth - 0.04, kCounter - 0.002},
                   {world_.add_texture(doors, 0.3), board_, board_});
  }

  /// Adds an image on the wall behind: just before the wall, and farther back than any thing.
  void add_picture(const Bitmap& picture, double x, double z, double width, double height, double warmth) {
    world_.add_panel({x, 0.398, z}, {width, 0, 0}, {0, 0, height}, world_.add_texture(picture, warmth));
  }

  /// Adds the light that a low sun throws through a window of two panes, if it shines.
  void add_sun(double x, double z, Random& random) {
    const double shift = random.uniform(-0.2, 0.2);  // drawn in any light
    if (!world_.light().sunlit) return;
    const Eigen::Vector3d right(0.5, 0, -0.12);
    for (const double panes : {0.0, 1.12}) {
      world_.add_panel(Eigen::Vector3d(x + shift, 0.399, z) + panes * right, right, {0.1, 0, 0.7}, sunlit_);
      world_.scenario().faces.back().brightness = kSunBrightness;
    }
  }

  void furnish_reception(Random& random) {
    add_monitor(about(0.45, 0.1, 0, -12, random), world_.add_texture(code_screen(512, 256, true, random)),
                materials_, &world_);
    add_keyboard(about(0.40, -0.2, 0, -8, random), world_.add_texture(keyboard(512, 128, random)), materials_,
                 &world_);
    double height = 0.0006;
    for (const double x : {-0.75, -0.42, -0.12}) {
      world_.add_sheet(about(x, -0.12, height += 0.0004, 10, random), 0.21, 0.297,
                       world_.add_texture(printed_page(256, 256, random)));
    }
    add_pen_pot(about(0.02, 0.05, 0, 0, random), materials_.light, materials_, random, &world_);
    add_mug(about(0.85, -0.1, 0, 60, random), world_.add_texture(wrapped_label(256, 128, 0.6F, random), 0.5),
            materials_, &world_);
    world_.add_cable(hanging_cable({0.45, 0.1, 0.2}, {0.2, 0.33, 0.01}, 0.1, random), 0.006, materials_.dark);
    world_.add_box(about(-0.6, 0.2, 0, 15, random), {0.22, 0.1, 0.16},
                   all_sides(world_.add_texture(cover(256, 256, random), 0.6)));
    add_picture(cover(512, 512, random), -0.95, 0.3, 0.5, 0.7, 0.5);
    add_picture(dead_leaves(512, 256, random), -0.1, 0.55, 0.8, 0.4, -0.5);
    add_sun(-0.3, 0.1, random);
    add_counter(2.2, 0.78, random);
  }

  void furnish_kitchenette(Random& random) {
    const TextureRegion machine = world_.add_texture(cover(256, 256, random), -0.3);
    world_.add_box(about(-0.6, 0.12, 0, 4, random), {0.34, 0.38, 0.42},
                   {machine, materials_.dark, materials_.dark});
    const TextureRegion door = world_.add_texture(code_screen(256, 128, false, random));
    world_.add_box(about(0.6, 0.14, 0, -3, random), {0.5, 0.36, 0.29},
                   {door, materials_.light, materials_.light});
    for (int i = 0; i < 4; ++i) {
      const TextureRegion label = world_.add_texture(
          wrapped_label(256, 128, random.uniform(0.3F, 0.85F), random), random.uniform(-0.8, 0.8));
      add_mug(about(-0.25 + 0.14 * i, random.uniform(-0.2, 0.1), 0, random.uniform(-180.0, 180.0), random),
              label, materials_, &world_);
    }
    const TextureRegion tin = world_.add_texture(wrapped_label(512, 256, 0.35F, random), 0.7);
    for (int i = 0; i < 3; ++i)
      world_.add_cylinder(about(0.02 + 0.1 * i, 0.26, 0, 30, random), 0.042, 0.14, tin, materials_.dark);
    Bitmap tiles(512, 256, 0.8F);
    for (float x = 0; x < 512; x += 32) tiles.fill_rectangle(x, 0, x + 1, 255, 0.55F);
    for (float y = 0; y < 256; y += 32) tiles.fill_rectangle(0, y, 511, y + 1, 0.55F);
    add_picture(tiles, -1.1, 0, 2.2, 0.6, 0.1);
    for (int i = 0; i < 3; ++i) {
      world_.add_box({{-0.72 + 0.72 * i, 0.23, 0.6}, 0}, {0.7, 0.33, 0.6}, all_sides(board_));
      world_.add_box({{-0.45 + 0.72 * i, 0.055, 0.66}, 0}, {0.02, 0.02, 0.12}, all_sides(materials_.dark));
    }
    add_picture(printed_page(256, 256, random), -0.1, 0.25, 0.21, 0.297, 0);
    add_sun(0.2, 0.05, random);
    add_counter(2.2, 0.78, random);
  }

  /// White walls, a handrail, a sign, an extinguisher.
  void furnish_landing(Random& random) {
    world_.add_cable({{-1.2, 0.33, 0.1}, {1.2, 0.33, 0.1}}, 0.05, materials_.dark);
    const TextureRegion bottle = world_.add_texture(wrapped_label(256, 256, 0.3F, random), 0.9);
    world_.add_cylinder(about(0.75, 0.28, -0.65, 20, random), 0.08, 0.5, bottle, materials_.dark);
    Bitmap sign(256, 128, 0.35F);
    sign.paste(printed_page(100, 100, random), 140, 14);
    sign.fill_rectangle(30, 40, 110, 88, 0.9F);
    add_picture(sign, -0.35, 0.45, 0.36, 0.18, -0.4);
    world_.add_box({{0.45, 0.395, 0.3}, 0}, {0.08, 0.01, 0.08}, all_sides(board_));
    world_.add_box({{-0.9, 0.36, 0.35}, 0}, {0.25, 0.08, 0.35}, all_sides(board_));
    add_sun(-0.6, -0.2, random);
  }

  void furnish_copier(Random& random) {
    const TextureRegion panel = world_.add_texture(keyboard(512, 128, random));
    const Placement at = about(-0.35, 0.02, -kCounter, 5, random);
    world_.add_box(at, {0.75, 0.62, 0.95}, {board_, materials_.light, board_});
    world_.add_box({at * Eigen::Vector3d(0, 0.05, 0.95), at.yaw}, {0.7, 0.5, 0.12},
                   all_sides(materials_.dark));
    world_.add_box({at * Eigen::Vector3d(0.1, -0.27, 0.955), at.yaw}, {0.36, 0.09, 0.03},
                   {materials_.dark, materials_.dark, panel});
    const TextureRegion wrap = world_.add_texture(cover(256, 128, random), -0.6);
    for (int pile = 0; pile < 2; ++pile) {
      double height = -kCounter;
      for (int i = random.integer(5, 9); i > 0; --i) {
        world_.add_box(about(0.4 + 0.35 * pile, 0.1, height, 0, random), {0.30, 0.22, 0.1},
                       {wrap, materials_.light, wrap});
        height += 0.1;
      }
    }
    Bitmap cork = pink_noise(512, 256, 64, 6, 0.09F, random);
    for (int y = 0; y < cork.height(); ++y) {
      for (int x = 0; x < cork.width(); ++x) cork.at(x, y) += 0.42F;
    }
    for (int i = 0; i < 11; ++i) {
      cork.paste(printed_page(60, 80, random), random.integer(5, 440), random.integer(5, 160));
    }
    add_picture(cork, -1.0, 0.3, 2.0, 0.85, 0.5);
    add_sun(0.1, -0.1, random);
  }

  void furnish_library(Random& random) {
    add_bookcase(-kCounter, materials_, random, &world_);
    add_sun(-0.5, 0.2, random);
  }

  [[nodiscard]] const SE3& map_from(int place) const {
    return world_.scenario().places[static_cast<size_t>(place)].body_from_place;
  }

  [[nodiscard]] static int floor_of(const SE3& map_from_place) {
    return static_cast<int>(map_from_place.translation().z() / kStorey);
  }

  /// Along the corridor, and up or down the stairs between.
  [[nodiscard]] static std::vector<Eigen::Vector3d> way(const SE3& from, const SE3& to) {
    const auto corridor = [](const SE3& place) -> Eigen::Vector3d {
      return {place.translation().x(), 2.2, kStorey * floor_of(place) + kEye};
    };
    std::vector<Eigen::Vector3d> points = {corridor(from)};
    int floor = floor_of(from);
    while (floor != floor_of(to)) {
      const int step = floor < floor_of(to) ? 1 : -1;
      const int lower = std::min(floor, floor + step);
      const Eigen::Vector3d bottom(-0.6, 0.6, kStorey * lower + kEye);
      const Eigen::Vector3d top(-0.6, kDepth - 1.4, kStorey * (lower + 1) + kEye);
      points.push_back(step > 0 ? bottom : top);
      points.push_back(step > 0 ? top : bottom);
      floor += step;
    }
    points.push_back(corridor(to));
    return points;
  }

  void make_route(Scenario* scenario) {
    Random random(options_.seed, kRoute);
    RouteBuilder route;
    int here = -1;
    const auto go = [&](int place, PhaseKind kind) {
      const SE3& to = map_from(place);
      const std::vector<Waypoint> stay =
          kind == PhaseKind::kMap ? survey(to, kScale, random) : glance(to, kScale, random);
      if (here >= 0) {
        route.add(PhaseKind::kWalk, place,
                  walk(route.last(), way(map_from(here), to), stay.front(), options_.walks, random));
      }
      route.add(kind, place, stay);
      here = place;
    };
    if (options_.session != Session::kVisit) {
      for (const int place : {kReception, kKitchenette, kLanding, kCopier, kLibrary})
        go(place, PhaseKind::kMap);
    }
    if (options_.session != Session::kMap) {
      for (const int place : {kCopier, kLanding, kReception, kKitchenette, kLibrary})
        go(place, PhaseKind::kVisit);
    }
    std::move(route).finish(options_.carrier, scenario);
  }

  ScenarioOptions options_;
  WorldBuilder world_;
  Materials materials_;
  TextureRegion board_;
  TextureRegion sunlit_;
  RoomSurfaces surfaces_;
};

}  // namespace

Scenario make_building(const ScenarioOptions& options) {
  return BuildingBuilder(options).build();
}

}  // namespace cairn
