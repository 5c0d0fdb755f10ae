// SPDX-License-Identifier: Apache-2.0
#include "tests/world/office.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/room.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr int kColumns = 5;
constexpr int kRows = 3;
constexpr int kDesks = kColumns * kRows;
constexpr double kColumnPitch = 2.0;  // m
constexpr double kRowPitch = 3.0;
constexpr double kDeskWidth = 1.7;
constexpr double kDeskBack = 0.44;
constexpr double kDeskDepth = 0.86;  // at the ends; the front curves in
constexpr double kFloorZ = -0.73;

enum Stream : uint64_t { kFurniture = 0x6F01, kLayout, kRouteNoise, kClutter = 0x6F10 };

/// What look-alike desks have in common.
struct Stock {
  Materials materials;
  TextureRegion keys;
  TextureRegion cloth;
  TextureRegion partition;
  TextureRegion drawers;
  TextureRegion chair;
  std::array<TextureRegion, 3> screens;  ///< what most computers show
  TextureRegion dark_screen;
  std::array<TextureRegion, 3> mugs;
  std::array<TextureRegion, 2> notes;
  TextureRegion goods;
  Bitmap top = Bitmap(1, 1);  ///< bare
};

double front_of(double x) {
  const double aside = 2 * x / kDeskWidth;
  return kDeskBack - kDeskDepth + 0.15 * std::pow(1 - aside * aside, 2);
}

class OfficeBuilder {
 public:
  explicit OfficeBuilder(const ScenarioOptions& options)
      : options_(options), world_("desks", light_of(options.daytime)) {}

  Scenario build() {
    choose_roles();
    fill_stock();
    for (int desk = 0; desk < kDesks; ++desk) add_desk(desk);
    add_room();
    Scenario& scenario = world_.scenario();
    make_route(&scenario);
    return std::move(scenario);
  }

 private:
  /// Which desks are nearly empty and which have no map.
  void choose_roles() {
    Random random(options_.seed, kLayout);
    std::array<int, kDesks> order;
    for (int i = 0; i < kDesks; ++i) order[static_cast<size_t>(i)] = i;
    for (int i = kDesks - 1; i > 0; --i) {
      std::swap(order[static_cast<size_t>(i)], order[static_cast<size_t>(random.integer(0, i))]);
    }
    unmapped_ = {order[0], order[1], order[2]};
    poor_ = {order[2], order[3]};
    for (int desk = 0; desk < kDesks; ++desk) {
      const int row = desk / kColumns;
      const int column = desk % kColumns;
      const Eigen::Vector3d origin(kColumnPitch * column + random.uniform(-0.04, 0.04),
                                   kRowPitch * row + random.uniform(-0.04, 0.04), 0);
      const double yaw = random.uniform(-0.05, 0.05);
      map_from_desk_.emplace_back(so3_exp({0, 0, yaw}), origin);
    }
  }

  [[nodiscard]] bool poor(int desk) const { return std::ranges::find(poor_, desk) != poor_.end(); }
  [[nodiscard]] bool mapped(int desk) const { return std::ranges::find(unmapped_, desk) == unmapped_.end(); }

  void fill_stock() {
    Random random(options_.seed, kFurniture);
    stock_.materials = {world_.add_plain(0.09F), world_.add_plain(0.72F)};
    stock_.keys = world_.add_texture(keyboard(512, 128, random));
    stock_.cloth = world_.add_texture(fabric(128, 128, 4, 0.32F, random), -0.3);
    stock_.partition = world_.add_texture(fabric(512, 256, 4, 0.42F, random), -0.5);
    stock_.drawers = world_.add_plain(0.5F);
    stock_.chair = world_.add_texture(fabric(128, 128, 2, 0.2F, random), 0.4);
    stock_.screens = {world_.add_texture(code_screen(512, 256, false, random)),
                      world_.add_texture(code_screen(512, 256, true, random)),
                      world_.add_texture(dead_leaves(512, 256, random), -0.4)};
    stock_.dark_screen = world_.add_plain(0.05F);
    for (TextureRegion& mug : stock_.mugs) {
      mug = world_.add_texture(wrapped_label(256, 128, random.uniform(0.3F, 0.85F), random),
                               random.uniform(-0.8, 0.8));
    }
    for (TextureRegion& note : stock_.notes) {
      Bitmap paper(64, 64, 0.76F);
      paper.paste(printed_page(52, 52, random), 6, 8);
      note = world_.add_texture(paper, 0.7);
    }
    stock_.goods = world_.add_texture(cover(128, 128, random), random.uniform(-0.8, 0.8));
    stock_.top = wood(1024, 512, random);
  }

  void add_desk(int desk) {
    const std::string name = "desk-" + std::to_string(desk + 1);
    world_.scenario().places.push_back({name, 0, map_from_desk_[static_cast<size_t>(desk)]});
    world_.begin(map_from_desk_[static_cast<size_t>(desk)], desk);
    Random random(options_.seed, kClutter + static_cast<uint64_t>(desk));
    add_computer(poor(desk), random);
    if (poor(desk)) {
      add_page(random, 0.0006);
    } else {
      add_clutter(random);
      add_notes(random);
    }
    add_top(poor(desk) ? 0 : 2, random);
    add_carcass(random);
  }

  /// About (x, y), turned by about `degrees`, both by as much as people differ.
  static Placement about(double x, double y, double degrees, Random& random, double spread = 0.03) {
    return {{x + random.uniform(-spread, spread), y + random.uniform(-spread, spread), 0},
            (degrees + random.uniform(-9.0, 9.0)) * std::numbers::pi / 180};
  }

  void add_computer(bool off, Random& random) {
    const Materials& materials = stock_.materials;
    TextureRegion screen =
        off ? stock_.dark_screen : stock_.screens[static_cast<size_t>(random.integer(0, 2))];
    if (!off && random.chance(0.25)) {
      screen = world_.add_texture(code_screen(512, 256, random.chance(0.5), random));
    }
    const Placement monitor = about(0.0, 0.22, 0, random, 0.05);
    add_monitor(monitor, screen, materials, &world_);
    add_keyboard(about(-0.02, -0.10, 0, random, 0.02), stock_.keys, materials, &world_);
    add_mouse(about(0.36, -0.10, -8, random, 0.02), stock_.cloth, materials, &world_);
    world_.add_cable(hanging_cable({0.0, -0.03, 0.012}, {0.08, 0.36, 0.004}, 0.02, random), 0.005,
                     materials.dark);
    const Placement phone = about(-0.62, 0.16, 25, random, 0.02);
    world_.add_box(phone, {0.17, 0.20, 0.05}, all_sides(materials.dark));
    world_.add_box({phone * Eigen::Vector3d(-0.05, 0, 0.05), phone.yaw}, {0.045, 0.19, 0.03},
                   all_sides(materials.dark));
  }

  void add_page(Random& random, double height) {
    const TextureRegion page = world_.add_texture(printed_page(256, 256, random));
    Placement at =
        about(random.uniform(-0.6, 0.6), random.uniform(-0.18, 0.0), random.uniform(-40.0, 40.0), random);
    at.base.z() = height;
    world_.add_sheet(at, 0.21, 0.297, page);
  }

  void add_clutter(Random& random) {
    const int pages = random.integer(2, 4);
    for (int i = 0; i < pages; ++i) add_page(random, 0.0006 + 0.0004 * i);
    // A pile of books or boxes on one side, goods and mugs on the other.
    const double side = random.chance(0.5) ? 1 : -1;
    double height = 0;
    const int books = random.integer(1, 3);
    for (int i = 0; i < books; ++i) {
      const TextureRegion front = world_.add_texture(cover(256, 256, random), random.uniform(-0.9, 0.9));
      const double thickness = random.uniform(0.018, 0.045);
      Placement at = about(0.62 * side, -0.02, 20 * side, random);
      at.base.z() = height;
      world_.add_box(at, {0.17, 0.24, thickness}, {stock_.materials.light, front, front});
      height += thickness;
    }
    add_mug(about(-0.40 * side, 0.05, random.uniform(-180.0, 180.0), random, 0.08),
            stock_.mugs[static_cast<size_t>(random.integer(0, 2))], stock_.materials, &world_);
    if (random.chance(0.6)) {
      add_pen_pot(about(-0.36 * side, 0.28, 0, random), stock_.goods, stock_.materials, random, &world_);
    }
    if (random.chance(0.6)) {
      world_.add_box(about(0.58 * side, 0.30, 20, random), {0.12, 0.09, 0.19}, all_sides(stock_.goods));
    }
    if (random.chance(0.5)) {
      const TextureRegion box = world_.add_texture(cover(128, 128, random), random.uniform(-0.9, 0.9));
      world_.add_box(about(0.40 * side, 0.33, -10, random), {0.10, 0.07, random.uniform(0.1, 0.2)},
                     all_sides(box));
    }
  }

  /// Notes, all alike, and a picture on the partition.
  void add_notes(Random& random) {
    const double y = kDeskBack + 0.018;
    const int notes = random.integer(1, 4);
    for (int i = 0; i < notes; ++i) {
      const double side = random.chance(0.5) ? 1 : -1;
      world_.add_panel({side * random.uniform(0.34, 0.7) - 0.04, y, random.uniform(0.2, 0.42)}, {0.076, 0, 0},
                       {0, 0, 0.076}, stock_.notes[static_cast<size_t>(random.integer(0, 1))]);
    }
    if (random.chance(0.7)) {
      const double side = random.chance(0.5) ? 1 : -1;
      world_.add_panel({side * 0.55 - 0.1, y - 0.001, random.uniform(0.18, 0.3)}, {0.2, 0, 0}, {0, 0, 0.15},
                       world_.add_texture(dead_leaves(128, 128, random), random.uniform(-0.9, 0.9)));
    }
  }

  /// The curved top, its picture with shadows and loose cables painted in.
  void add_top(int tangles, Random& random) {
    Bitmap picture = stock_.top;
    const auto width = static_cast<float>(picture.width());
    const auto height = static_cast<float>(picture.height());
    for (int i = 0; i < tangles; ++i) {
      draw_cable_tangle(&picture, random.uniform(0.1F, 0.9F) * width, random.uniform(0.08F, 0.3F) * height,
                        60, 2.5F, random);
    }
    world_.paint_shadows(&picture, kDeskWidth, kDeskDepth);
    const float sunspot = random.uniform(0.2F, 0.8F);  // drawn in any light: the rest stays where it is
    if (world_.light().sunlit) {
      picture.shade_rectangle(sunspot * width, 0.6F * height, 0.16F * width, 0.3F * height, 0.5F, 4, -0.55F);
      picture.clamp();
    }
    const TextureRegion top = world_.add_texture(picture, 0.5);
    TextureRegion edge = top;
    edge.height = 12;
    constexpr int kStrips = 10;
    const Eigen::Vector3d origin(-kDeskWidth / 2, kDeskBack - kDeskDepth, 0);
    const Eigen::Vector3d down(0, 0, -0.03);
    for (int i = 0; i < kStrips; ++i) {
      const double left = kDeskWidth * (static_cast<double>(i) / kStrips - 0.5);
      const double right = kDeskWidth * (static_cast<double>(i + 1) / kStrips - 0.5);
      const Eigen::Vector3d front_left(left, front_of(left), 0);
      const Eigen::Vector3d front_right(right, front_of(right), 0);
      world_.add_cut_out({front_left, front_right, {right, kDeskBack, 0}, {left, kDeskBack, 0}}, origin,
                         {kDeskWidth, 0, 0}, {0, kDeskDepth, 0}, top);
      world_.add_panel(front_left + down, front_right - front_left, -down, edge);
    }
  }

  void add_carcass(Random& random) {
    const Placement drawers{{-0.62, 0.1, kFloorZ}, 0};
    world_.add_box(drawers, {0.42, 0.6, 0.69}, all_sides(stock_.drawers));
    world_.add_box({{0, 0.46 + 0.02, kFloorZ}, 0}, {1.92, 0.04, 1.30}, all_sides(stock_.partition));
    world_.add_box({{0.96, 0.22, kFloorZ}, 0}, {0.04, 0.48, 1.15}, all_sides(stock_.partition));
    // A chair pushed aside.
    const Placement chair{{random.uniform(0.4, 0.7), random.uniform(-0.75, -0.6), kFloorZ},
                          random.uniform(-0.6, 0.6)};
    world_.add_box({chair * Eigen::Vector3d(0, 0, 0.40), chair.yaw}, {0.46, 0.44, 0.07},
                   all_sides(stock_.chair));
    world_.add_cylinder(chair, 0.04, 0.40, stock_.materials.dark, stock_.materials.dark);
  }

  void add_room() {
    Random random(options_.seed, kFurniture + 0x100);
    world_.begin(SE3());
    constexpr double kHeight = 2.7;
    const RoomSurfaces surfaces = make_surfaces(random, &world_);
    cairn::add_room({-2.8, -2.4, kFloorZ},
                    {kColumnPitch * (kColumns - 1) + 2.8, kRowPitch * (kRows - 1) + 1.6, kFloorZ + kHeight},
                    surfaces, &world_);
  }

  /// Position of the hand, at chest height, of somebody who stands on the aisle before a desk.
  [[nodiscard]] Eigen::Vector3d aisle(int desk) const {
    return map_from_desk_[static_cast<size_t>(desk)] * Eigen::Vector3d(0, -1.05, 0.55);
  }

  /// A way along the aisle, and about the end of the row into another one.
  [[nodiscard]] std::vector<Eigen::Vector3d> way(int from, int to) const {
    const Eigen::Vector3d begin = aisle(from);
    const Eigen::Vector3d end = aisle(to);
    if (from / kColumns == to / kColumns) return {begin, end};
    const bool right = from % kColumns + to % kColumns >= kColumns - 1;
    const double x = right ? kColumnPitch * (kColumns - 1) + 1.5 : -1.5;
    return {begin, {x, begin.y(), begin.z()}, {x, end.y(), end.z()}, end};
  }

  void make_route(Scenario* scenario) {
    Random random(options_.seed, kRouteNoise);
    RouteBuilder route;
    int here = -1;
    const auto go = [&](int desk, PhaseKind kind) {
      const SE3& map_from_desk = map_from_desk_[static_cast<size_t>(desk)];
      const std::vector<Waypoint> stay =
          kind == PhaseKind::kMap ? survey(map_from_desk, 1, random) : glance(map_from_desk, 1, random);
      if (here >= 0)
        route.add(PhaseKind::kWalk, desk,
                  walk(route.last(), way(here, desk), stay.front(), options_.walks, random));
      route.add(kind, desk, stay);
      here = desk;
    };
    if (options_.session != Session::kVisit) {
      for (const int desk : serpentine({0, 1, 2}, false)) {
        if (mapped(desk)) go(desk, PhaseKind::kMap);
      }
    }
    if (options_.session != Session::kMap) {
      // Not the row first that was mapped last: every visit is a return.
      for (const int desk : serpentine({1, 0, 2}, true)) go(desk, PhaseKind::kVisit);
    }
    std::move(route).finish(options_.carrier, scenario);
  }

  /// Every desk in turn, row by row, to and fro; the first row from the left, or from the right.
  [[nodiscard]] static std::vector<int> serpentine(const std::array<int, kRows>& rows, bool from_right) {
    std::vector<int> order;
    for (const int row : rows) {
      for (int i = 0; i < kColumns; ++i)
        order.push_back(row * kColumns + (from_right ? kColumns - 1 - i : i));
      from_right = !from_right;
    }
    return order;
  }

  ScenarioOptions options_;
  WorldBuilder world_;
  Stock stock_;
  std::vector<SE3> map_from_desk_;
  std::array<int, 3> unmapped_{};
  std::array<int, 2> poor_{};
};

}  // namespace

Scenario make_office(const ScenarioOptions& options) {
  return OfficeBuilder(options).build();
}

}  // namespace cairn
