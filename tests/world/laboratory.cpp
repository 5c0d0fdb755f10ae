// SPDX-License-Identifier: Apache-2.0
#include "tests/world/laboratory.h"

#include <array>
#include <numbers>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/room.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kBench = 0.9;    // m, height
constexpr double kTrolley = 0.6;  // m, height
constexpr double kRoomScale = 2.1;
constexpr double kRobotScale = 0.75;
constexpr double kGlideSeconds = 1.8;

enum Stream : uint64_t { kSurfaces = 0x1A01, kBenchThings, kRobotThings, kRoute };
enum PlaceIndex : int { kRoom, kRobot };

class LaboratoryBuilder {
 public:
  explicit LaboratoryBuilder(const ScenarioOptions& options)
      : options_(options), world_("laboratory", light_of(options.daytime)) {}

  Scenario build() {
    Random random(options_.seed, kSurfaces);
    materials_ = {world_.add_plain(0.09F), world_.add_plain(0.72F)};
    grey_ = world_.add_plain(0.5F);
    Scenario& scenario = world_.scenario();
    scenario.places = {{"room", 0, SE3()}, {"robot", 1, SE3()}};
    scenario.bodies.push_back({stand(0.7, -0.8, -0.25), {}});
    world_.begin(SE3(), kRoom);
    add_bench();
    add_room({-3, -4, -kBench}, {3, 0.45, 2.8 - kBench}, make_surfaces(random, &world_), &world_);
    world_.begin(SE3(), kRobot, 1);
    add_robot();
    make_route(&scenario);
    return std::move(scenario);
  }

 private:
  /// The trolley's top, at a point of the room.
  static SE3 stand(double x, double y, double yaw) {
    return {so3_exp({0, 0, yaw}), Eigen::Vector3d(x, y, kTrolley - kBench)};
  }
  static Placement about(double x, double y, double z, double degrees, Random& random) {
    return {{x + random.uniform(-0.03, 0.03), y + random.uniform(-0.03, 0.03), z},
            (degrees + random.uniform(-8.0, 8.0)) * std::numbers::pi / 180};
  }

  /// A bench along the wall with instruments, shelves and posters above it.
  void add_bench() {
    Random random(options_.seed, kBenchThings);
    add_monitor(about(-0.9, 0.1, 0, 12, random), world_.add_texture(code_screen(512, 256, false, random)),
                materials_, &world_);
    add_monitor(about(-0.3, 0.12, 0, -6, random), world_.add_texture(code_screen(512, 256, true, random)),
                materials_, &world_);
    add_keyboard(about(-0.65, -0.18, 0, 3, random), world_.add_texture(keyboard(512, 128, random)),
                 materials_, &world_);
    for (const double x : {0.3, 0.85, 1.45}) {  // instruments: a screen beside rows of knobs
      Bitmap front(512, 256, 0.45F);
      front.paste(code_screen(256, 200, false, random), 20, 28);
      front.paste(keyboard(200, 100, random), 292, 120);
      world_.add_box(about(x, 0.1, 0, 0, random), {0.42, 0.36, random.uniform(0.2, 0.34)},
                     {world_.add_texture(front, random.uniform(-0.5, 0.5)), grey_, grey_});
    }
    double height = 0.0006;
    for (const double x : {-1.4, -1.15, 0.1, 0.6}) {
      world_.add_sheet(about(x, -0.17, height += 0.0004, 15, random), 0.21, 0.297,
                       world_.add_texture(printed_page(256, 256, random)));
    }
    add_mug(about(1.1, -0.2, 0, 50, random), world_.add_texture(wrapped_label(256, 128, 0.7F, random), 0.6),
            materials_, &world_);
    world_.add_cable(hanging_cable({0.3, 0.0, 0.1}, {0.9, -0.05, 0.02}, 0.08, random), 0.008,
                     materials_.dark);
    world_.add_cable(hanging_cable({0.85, 0.0, 0.1}, {-0.2, 0.3, 0.02}, 0.06, random), 0.008, grey_);
    for (const double z : {0.75, 1.15}) {
      world_.add_box({{0.3, 0.32, z}, 0}, {2.4, 0.24, 0.03}, all_sides(grey_));
      for (double x = -0.85; x < 1.35; x += random.uniform(0.16, 0.34)) {
        const TextureRegion label = world_.add_texture(cover(128, 128, random), random.uniform(-0.9, 0.9));
        world_.add_box({{x, 0.3, z + 0.03}, 0}, {0.13, 0.16, random.uniform(0.12, 0.26)}, all_sides(label));
      }
    }
    world_.add_panel({-1.75, 0.448, 0.3}, {0.6, 0, 0}, {0, 0, 0.8},
                     world_.add_texture(cover(512, 512, random), 0.4));
    world_.add_panel({-1.05, 0.448, 0.75}, {0.4, 0, 0}, {0, 0, 0.3},
                     world_.add_texture(dead_leaves(256, 256, random), -0.4));
    constexpr double kWidth = 3.6;
    constexpr double kDepth = 0.8;
    Bitmap picture = wood(1024, 256, random);
    world_.paint_shadows(&picture, kWidth, kDepth);
    const TextureRegion top = world_.add_texture(picture, 0.4);
    world_.add_panel({-kWidth / 2, -kDepth / 2, 0}, {kWidth, 0, 0}, {0, kDepth, 0}, top);
    world_.add_box({{0, 0, -kBench}, 0}, {kWidth - 0.1, kDepth - 0.1, kBench - 0.002}, all_sides(grey_));
  }

  /// An arm of boxes with stripes, labels and cables on its controller, in the frame of the trolley's top.
  void add_robot() {
    Random random(options_.seed, kRobotThings);
    Bitmap stripes(128, 128, 0.75F);
    for (int y = 0; y < 128; ++y) {
      for (int x = 0; x < 128; ++x) {
        if ((x + y) % 48 < 24) stripes.at(x, y) = 0.12F;
      }
    }
    const TextureRegion warning = world_.add_texture(stripes, 0.7);
    const TextureRegion plate = world_.add_texture(printed_page(256, 256, random), 0.3);
    const TextureRegion board = world_.add_texture(dead_leaves(256, 256, random), 0.2);
    const TextureRegion label = world_.add_texture(wrapped_label(512, 256, 0.75F, random), 0.8);
    const TextureRegion keys = world_.add_texture(keyboard(256, 128, random));
    world_.add_cylinder({{0, 0.05, 0}, 0.3}, 0.11, 0.14, label, warning);
    world_.add_box({{0, 0.05, 0.14}, 0.5}, {0.13, 0.13, 0.20}, {plate, label, grey_});
    world_.add_box({{-0.09, 0.03, 0.30}, 0.5}, {0.34, 0.09, 0.09}, {label, warning, board});
    world_.add_box({{-0.24, -0.06, 0.20}, 0.2}, {0.07, 0.07, 0.12}, {warning, plate, grey_});
    world_.add_box({{-0.25, -0.07, 0.12}, 0.2}, {0.12, 0.03, 0.08}, all_sides(materials_.dark));
    world_.add_box({{0.24, 0.06, 0}, -0.3}, {0.20, 0.26, 0.16}, {board, plate, keys});
    world_.add_box({{0.20, -0.19, 0}, 0.2}, {0.22, 0.13, 0.03}, {materials_.dark, materials_.dark, keys});
    world_.add_box({{-0.26, 0.16, 0}, 0.4}, {0.12, 0.12, 0.12},
                   all_sides(world_.add_texture(cover(128, 128, random), -0.6)));
    world_.add_sheet({{-0.05, -0.20, 0.0008}, 0.1}, 0.21, 0.15, plate);
    world_.add_cable(hanging_cable({0.2, 0.05, 0.15}, {0.05, 0.1, 0.3}, 0.1, random), 0.012, materials_.dark);
    world_.add_cable(hanging_cable({0.25, 0, 0.12}, {-0.2, 0.2, 0.02}, 0.05, random), 0.008, grey_);
    constexpr double kWidth = 0.8;
    constexpr double kDepth = 0.6;
    Bitmap sheet = fabric(512, 512, 8, 0.45F, random);
    world_.paint_shadows(&sheet, kWidth, kDepth);
    const TextureRegion top = world_.add_texture(sheet);
    world_.add_panel({-kWidth / 2, -kDepth / 2, 0}, {kWidth, 0, 0}, {0, kDepth, 0}, top);
    world_.add_box({{0, 0, -kTrolley}, 0}, {kWidth, kDepth, kTrolley - 0.002}, {warning, grey_, grey_});
  }

  void make_route(Scenario* scenario) {
    Random random(options_.seed, kRoute);
    RouteBuilder route;
    Body& robot = scenario->bodies[1];
    const auto go = [&](int place, PhaseKind kind) {
      // The room with the robot before it, the robot at the height of its arm.
      const SE3 to = place == kRoom ? SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, -0.6, -0.2))
                                    : robot.at(route.now() + kGlideSeconds) *
                                          SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.12));
      const double scale = place == kRoom ? kRoomScale : kRobotScale;
      const std::vector<Waypoint> stay =
          kind == PhaseKind::kMap ? survey(to, scale, random) : glance(to, scale, random);
      if (!route.empty()) {
        const std::array<Eigen::Vector3d, 1> back = {Eigen::Vector3d(0.2, -3.3, 0.65)};
        route.add(PhaseKind::kWalk, place, walk(route.last(), back, stay.front(), options_.walks, random));
      }
      route.add(kind, place, stay);
    };
    if (options_.session != Session::kVisit) {
      for (const int place : {kRobot, kRoom}) go(place, PhaseKind::kMap);
    }
    if (options_.session != Session::kMap) {
      for (const int place : {kRobot, kRoom, kRobot, kRoom}) go(place, PhaseKind::kVisit);
      // Moved at once when the wearer turns away from the room.
      const double begin = route.now() - 2 * kWaypointInterval;
      robot.glides.push_back({begin, begin + kGlideSeconds, stand(-0.75, -0.85, 0.35)});
      for (const int place : {kRobot, kRoom, kRobot}) go(place, PhaseKind::kVisit);
    }
    std::move(route).finish(options_.carrier, scenario);
  }

  ScenarioOptions options_;
  WorldBuilder world_;
  Materials materials_;
  TextureRegion grey_;
};

}  // namespace

Scenario make_laboratory(const ScenarioOptions& options) {
  return LaboratoryBuilder(options).build();
}

}  // namespace cairn
