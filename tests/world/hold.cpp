// SPDX-License-Identifier: Apache-2.0
#include "tests/world/hold.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include "tests/world/desk.h"
#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/room.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr double kFloor = -0.73;  // as make_desk() has it
constexpr double kHalfRoom = 2.5;
constexpr double kRear = -3;
constexpr size_t kStartWaypoints = 7;  // of the desk's route: aside and back
constexpr double kFirstTurn = 5;       // s
constexpr double kRest = 1.5;          // s between turns

enum Stream : uint64_t { kBookcase = 0x401D01, kSideboard, kSurfaces, kHand, kText };

/// Adds what stands at the right wall and at the rear one, in a room that is closed.
void furnish(uint64_t seed, WorldBuilder* world) {
  const Materials materials = {world->add_plain(0.09F), world->add_plain(0.72F)};
  Random surfaces(seed, kSurfaces);
  world->begin(SE3());
  TextureRegion wall = world->add_texture(plaster(256, surfaces), 0.2);
  wall.width *= 2.5;
  world->add_panel({kHalfRoom, kRear, kFloor}, {-2 * kHalfRoom, 0, 0}, {0, 0, 3}, wall);
  world->add_panel({-kHalfRoom, 0.44, kFloor + 3}, {2 * kHalfRoom, 0, 0}, {0, kRear - 0.44, 0}, wall);

  Random books(seed, kBookcase);
  world->begin(SE3(so3_exp({0, 0, -std::numbers::pi / 2}), Eigen::Vector3d(kHalfRoom - 0.4, -1.1, 0)));
  add_bookcase(kFloor, materials, books, world);
  world->add_panel({-1.5, 0.398, 0.1}, {0.25, 0, 0}, {0, 0, 0.5}, world->add_texture(cover(256, 512, books)));

  Random things(seed, kSideboard);
  world->begin(SE3(so3_exp({0, 0, std::numbers::pi}), Eigen::Vector3d(0, kRear + 0.4, 0)));
  const TextureRegion doors = world->add_texture(wood(1024, 256, things), 0.4);
  world->add_box({{0, 0.15, kFloor}, 0}, {3.6, 0.45, 0.7}, all_sides(doors));
  for (double x = -1.6; x < 1.6; x += things.uniform(0.22, 0.4)) {
    const TextureRegion label = world->add_texture(cover(128, 128, things), things.uniform(-0.8, 0.8));
    world->add_box({{x, things.uniform(0.05, 0.25), kFloor + 0.7}, things.uniform(-0.4, 0.4)},
                   {things.uniform(0.1, 0.2), 0.12, things.uniform(0.1, 0.3)}, all_sides(label));
  }
  for (const double x : {-1.7, -0.9, 0.0, 0.8}) {
    const Bitmap pattern = x < 0 ? cover(512, 512, things) : dead_leaves(512, 512, things);
    world->add_panel({x, 0.398, 0.5}, {0.6, 0, 0}, {0, 0, 0.6}, world->add_texture(pattern));
  }
}

/// The desk in its room, with the beginning of its route only.
Scenario desk_in_room(const char* name, const ScenarioOptions& options) {
  WorldBuilder world(make_desk({.seed = options.seed, .daytime = options.daytime}),
                     light_of(options.daytime));
  furnish(options.seed, &world);
  Scenario scenario = std::move(world.scenario());
  scenario.name = name;
  return scenario;
}

std::vector<Waypoint> start_of(const Scenario& desk) {
  return {desk.route.begin(), desk.route.begin() + kStartWaypoints};
}

void follow(std::span<const Waypoint> waypoints, Carrier carrier, Scenario* scenario) {
  RouteBuilder route;
  route.add(PhaseKind::kMap, 0, waypoints);
  std::move(route).finish(carrier, scenario);
}

double seconds_of(double radians, double peak_degrees_per_second) {
  return kMinimumJerkPeak * std::abs(radians) / (peak_degrees_per_second * kRadiansPerDegree);
}

struct Pace {
  double sign;
  double peak;  ///< degrees/s
};

/// The turn again and again with rests between, its greater angle (yaw or roll) at each of the paces.
std::vector<Turn> turns_of(const Turn& turn, std::span<const Pace> paces) {
  std::vector<Turn> turns;
  double begin = kFirstTurn;
  for (const auto& [sign, peak] : paces) {
    Turn next = turn;
    next.begin = begin;
    next.going = seconds_of(std::max(std::abs(turn.yaw), std::abs(turn.roll)), peak);
    next.yaw *= sign;
    next.roll *= sign;
    turns.push_back(next);
    begin = next.end() + kRest;
  }
  return turns;
}

/// Stays about where the sideways motion ends, as a hand does, while the camera is turned.
Scenario turned_before_desk(const char* name, const ScenarioOptions& options, const Turn& turn,
                            std::span<const Pace> paces) {
  Scenario scenario = desk_in_room(name, options);
  scenario.turns = turns_of(turn, paces);
  std::vector<Waypoint> route = start_of(scenario);
  const Waypoint start = route.front();
  Random random(options.seed, kHand);
  while (static_cast<double>(route.size()) * kWaypointInterval < scenario.turns.back().end() + kRest) {
    Waypoint near = start;
    for (int axis = 0; axis < 3; ++axis) near.eye[axis] += 0.006 * random.normal();
    route.push_back(near);
  }
  follow(route, options.carrier, &scenario);
  return scenario;
}

Bitmap canvas_of(const Camera& camera) {
  return {camera.width(), camera.height()};
}

/// White letters that the image shows through, and their dark outline, as a camera application leaves them.
Overlay line_of_text(const Camera& camera, uint64_t seed) {
  Overlay overlay{canvas_of(camera), canvas_of(camera)};
  for (const float offset : {1.0F, 0.0F}) {  // the outline lies below
    Random random(seed, kText);
    Bitmap ink = canvas_of(camera);
    draw_text_line(&ink, 14 + offset, 12 + offset, 190, 15, 1, random);
    for (int y = 0; y < ink.height(); ++y) {
      for (int x = 0; x < ink.width(); ++x) {
        const float covered = 0.85F * ink.at(x, y);
        if (covered <= 0) continue;
        overlay.opacity.at(x, y) = std::max(overlay.opacity.at(x, y), covered);
        overlay.grey.at(x, y) = offset > 0 ? 0.1F : overlay.grey.at(x, y) * (1 - covered) + covered;
      }
    }
  }
  return overlay;
}

/// Black but for a circle that is cut at top and bottom, as the image of an endoscope lies on its sensor.
Overlay round_border(const Camera& camera) {
  Overlay overlay{canvas_of(camera), canvas_of(camera)};
  const double radius = 0.6 * camera.height();
  const Eigen::Vector2d centre(0.49 * camera.width(), 0.44 * camera.height());
  const Eigen::Vector2d notch = centre + radius * Eigen::Vector2d(-0.45, 0.893);
  constexpr double kNotch = 14;  // px
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const Eigen::Vector2d pixel(x, y);
      const double outside = std::max((pixel - centre).norm() - radius, kNotch - (pixel - notch).norm());
      overlay.opacity.at(x, y) = static_cast<float>(std::clamp(outside / 2 + 0.5, 0.0, 1.0));
      overlay.grey.at(x, y) = 0.02F;
    }
  }
  return overlay;
}

Scenario to_the_wall(const char* name, const ScenarioOptions& options) {
  const Turn turn{
      .staying = 2, .yaw = 95 * kRadiansPerDegree, .pitch = 45 * kRadiansPerDegree, .pivot = {0, 0, -0.08}};
  constexpr std::array<Pace, 3> kPaces = {{{1, 30}, {1, 90}, {1, 150}}};
  return turned_before_desk(name, options, turn, kPaces);
}

}  // namespace

Scenario make_pan(const ScenarioOptions& options) {
  const Turn turn{.staying = 2, .yaw = -90 * kRadiansPerDegree};
  constexpr std::array<Pace, 4> kPaces = {{{1, 90}, {1, 60}, {1, 120}, {1, 150}}};
  return turned_before_desk("pan", options, turn, kPaces);
}

Scenario make_roll(const ScenarioOptions& options) {
  const Turn turn{.staying = 0.5, .roll = 60 * kRadiansPerDegree};
  constexpr std::array<Pace, 4> kPaces = {{{1, 60}, {-1, 90}, {1, 120}, {-1, 150}}};
  return turned_before_desk("roll", options, turn, kPaces);
}

Scenario make_look_away(const ScenarioOptions& options) {
  return to_the_wall("look-away", options);
}

Scenario make_watermark(const ScenarioOptions& options) {
  Scenario scenario = to_the_wall("watermark", options);
  scenario.overlay = line_of_text(*scenario.camera, options.seed);
  return scenario;
}

Scenario make_border(const ScenarioOptions& options) {
  Scenario scenario = make_desk(options);
  scenario.name = "border";
  constexpr std::array<Pace, 4> kPaces = {{{1, 60}, {-1, 80}, {-1, 100}, {1, 120}}};
  const Turn turn{
      .staying = 0.5, .yaw = 30 * kRadiansPerDegree, .roll = 35 * kRadiansPerDegree, .pivot = {0, 0, -0.08}};
  scenario.turns = turns_of(turn, kPaces);
  scenario.overlay = round_border(*scenario.camera);
  return scenario;
}

Scenario make_rush(const ScenarioOptions& options) {
  Scenario scenario = make_desk(options);
  scenario.name = "rush";
  scenario.calm = 8;
  return scenario;
}

Scenario make_outage(const ScenarioOptions& options) {
  Scenario scenario = desk_in_room("outage", options);
  const std::array<Waypoint, 8> stations = {{
      {{0.45, -0.75, 0.50}, {0.55, 0.10, 0.10}},   // the desk's right half
      {{0.80, -0.95, 0.58}, {1.30, 0.20, 0.10}},   // its end
      {{0.95, -1.10, 0.66}, {2.20, -0.30, 0.30}},  // the near end of the bookcase
      {{1.00, -1.50, 0.72}, {2.20, -1.40, 0.30}},
      {{0.90, -1.70, 0.72}, {2.10, -2.30, 0.20}},
      {{0.60, -1.60, 0.74}, {1.20, -2.80, 0.20}},  // the sideboard
      {{0.00, -1.55, 0.74}, {0.00, -2.80, 0.25}},
      {{-0.60, -1.60, 0.74}, {-0.80, -2.80, 0.25}},
  }};
  std::vector<Waypoint> route = start_of(scenario);
  Random random(options.seed, kHand);
  constexpr int kSteps = 7;  // of a leg: 4.2 s
  Waypoint last = route.back();
  const auto go = [&](const Waypoint& next) {
    for (int step = 1; step <= kSteps; ++step) {
      const double part = static_cast<double>(step) / kSteps;
      Waypoint view{last.eye + part * (next.eye - last.eye),
                    last.target + part * (next.target - last.target)};
      for (int axis = 0; axis < 3; ++axis) view.eye[axis] += 0.012 * random.normal();
      route.push_back(view);
    }
    last = next;
  };
  for (const Waypoint& station : stations) go(station);
  follow(route, options.carrier, &scenario);
  return scenario;
}

}  // namespace cairn
