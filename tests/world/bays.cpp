// SPDX-License-Identifier: Apache-2.0
#include "tests/world/bays.h"

#include <array>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr int kBays = 30;
constexpr double kHalfWidth = 1.3;  // m
constexpr double kRailing = 1.15;
constexpr double kPortal = 2.7;  // height
constexpr double kEye = 1.55;
constexpr double kWalked = 48;  // m, to well before its end
constexpr double kStep = 1.4 * kWaypointInterval;

enum Stream : uint64_t { kSteel = 0xBA15, kTown, kRoute };

/// Every bay shows the same pictures: what looks the same need not be the same place.
struct Pictures {
  TextureRegion deck;
  TextureRegion post;
  TextureRegion rail;
};

Bitmap planks(Random& random) {
  Bitmap deck = wood(512, 512, random);
  for (int y = 0; y < 512; ++y) {
    for (int x = 0; x < 512; ++x) deck.at(x, y) *= 0.55F;
  }
  for (int plank = 0; plank < 16; ++plank) {
    const auto y = static_cast<float>(32 * plank);
    deck.fill_rectangle(0, y, 511, y + 2, 0.05F);
    for (const float x : {40.0F, 256.0F, 470.0F}) deck.fill_disc(x, y + 16, 2.5F, 0.12F);
  }
  return deck;
}

void add_bay(double y, const Pictures& pictures, WorldBuilder* world) {
  world->add_panel({-kHalfWidth, y, 0}, {2 * kHalfWidth, 0, 0}, {0, kBay, 0}, pictures.deck);
  const BoxSides post = all_sides(pictures.post);
  const BoxSides rail = all_sides(pictures.rail);
  for (const double side : {-1.0, 1.0}) {
    const double x = side * kHalfWidth;
    world->add_box({{x, y, 0}, 0}, {0.1, 0.1, kPortal}, post);
    world->add_box({{x, y + kBay / 2, 0}, 0}, {0.05, 0.05, kRailing}, post);
    for (const double z : {0.12, 0.55, kRailing}) {
      world->add_box({{x, y + kBay / 2, z}, 0}, {0.06, kBay - 0.1, 0.05}, rail);
    }
    world->add_cable({{x, y, 0.1}, {x, y + kBay / 2, kRailing}, {x, y + kBay, 0.1}}, 0.05, pictures.post);
    world->add_cable({{x, y, kRailing}, {x, y + kBay, kPortal}}, 0.06, pictures.post);
  }
  world->add_box({{0, y, kPortal}, 0}, {2 * kHalfWidth, 0.12, 0.14}, rail);
}

/// Dark water, and houses at the far end and along the banks with some of their windows lit.
void add_town(Random& random, WorldBuilder* world) {
  Bitmap water = pink_noise(256, 256, 64, 5, 0.03F, random);
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) water.at(x, y) += 0.07F;
  }
  TextureRegion sea = world->add_texture(water);
  sea.width *= 30;
  sea.height *= 30;
  world->add_panel({-150, -30, -6}, {300, 0, 0}, {0, 300, 0}, sea);
  for (int house = 0; house < 26; ++house) {
    Bitmap front(128, 128, random.uniform(0.03F, 0.10F));
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 7; ++column) {
        const auto x = static_cast<float>(8 + 17 * column);
        const auto y = static_cast<float>(8 + 17 * row);
        const float lit = random.chance(0.35) ? random.uniform(0.35F, 0.9F) : 0.02F;
        front.fill_rectangle(x, y, x + 8, y + 11, lit);
      }
    }
    const double x = -120 + 9.3 * house + random.uniform(-2.0, 2.0);
    const double width = random.uniform(8.0, 13.0);
    world->add_panel({x, random.uniform(140.0, 170.0), -6}, {width, 0, 0}, {0, 0, random.uniform(12.0, 30.0)},
                     world->add_texture(front));
  }
}

}  // namespace

Scenario make_bays(const ScenarioOptions& options) {
  WorldBuilder world("bays", light_of(options.daytime));
  world.scenario().places.push_back({"bridge", 0, SE3()});
  world.begin(SE3(), 0);
  Random random(options.seed, kSteel);
  const Pictures pictures = {world.add_texture(planks(random)),
                             world.add_texture(rough(64, 512, 0.45F, 0.09F, 40, random)),
                             world.add_texture(rough(512, 64, 0.5F, 0.09F, 40, random))};
  for (int bay = -2; bay < kBays; ++bay) add_bay(bay * kBay, pictures, &world);
  Random town(options.seed, kTown);
  add_town(town, &world);
  Random hand(options.seed, kRoute);
  const auto ahead = [&](double y) -> Waypoint {
    // Drawn one after the other: the order in which arguments are evaluated differs between processors.
    const double up = 0.02 * hand.normal();
    const double aside = 0.05 * hand.normal();
    const double target_up = 0.06 * hand.normal();
    const double target_aside = 0.12 * hand.normal();
    const Eigen::Vector3d eye(aside, y, kEye + up);
    return {eye, eye + Eigen::Vector3d(target_aside, 3, -0.45 + target_up)};
  };
  std::vector<Waypoint> route;
  for (const double part : {0.0, 0.0, 0.0, 0.5, 1.0, 0.6, 0.0}) {
    const Eigen::Vector3d eye(0.5 * part - 0.2, 0, kEye);
    route.push_back({eye, eye + Eigen::Vector3d(0, 3, -0.45)});
  }
  for (double y = 0.3 * kStep; y < kWalked; y += kStep) route.push_back(ahead(y));
  RouteBuilder builder;
  builder.add(PhaseKind::kMap, 0, route);
  std::move(builder).finish(options.carrier, &world.scenario());
  return std::move(world.scenario());
}

}  // namespace cairn
