// SPDX-License-Identifier: Apache-2.0
#include "tests/world/desk.h"

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/world/furniture.h"
#include "tests/world/patterns.h"
#include "tests/world/route.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kDeskWidth = 1.6;
constexpr double kDeskDepth = 0.8;
constexpr double kWallY = 0.44;
constexpr double kFloorZ = -0.73;
constexpr double kRadiansPerDegree = std::numbers::pi / 180;

// One random stream per thing, so that a change of one leaves the others as they are.
enum Stream : uint64_t { kSurfaces = 1, kPrint, kScreens, kBooks, kGoods, kMugs, kCables, kRoute };

/// Builds the desk part by part; places vary a little with the seed, pictures altogether.
class DeskBuilder {
 public:
  /// `moved`: as it is once somebody has been at it.
  DeskBuilder(const ScenarioOptions& options, const char* name, bool moved)
      : options_(options), seed_(options.seed), is_moved_(moved), world_(name, light_of(options.daytime)) {}

  Scenario build() {
    world_.begin(SE3(), 0);
    world_.scenario().places.push_back({"desk", 0, SE3()});
    materials_ = {world_.add_plain(0.09F), world_.add_plain(0.72F)};
    add_screens();
    add_keyboard_and_mouse();
    add_books();
    add_goods();
    add_mugs();
    add_print();
    add_cables();
    add_wall();
    add_desk_and_floor();  // last: its texture holds the shadows of what stands there
    Scenario& scenario = world_.scenario();
    RouteBuilder route;
    route.add(PhaseKind::kMap, 0, make_route());
    std::move(route).close(options_.carrier, &scenario);
    return std::move(scenario);
  }

 private:
  /// About (x, y), turned by about `degrees`.
  static Placement place(double x, double y, double degrees, Random& random, double z = 0) {
    return {{x + random.uniform(-0.012, 0.012), y + random.uniform(-0.012, 0.012), z},
            (degrees + random.uniform(-4.0, 4.0)) * kRadiansPerDegree};
  }
  [[nodiscard]] static BoxSides all_sides(const TextureRegion& region) { return {region, region, region}; }

  void add_screens() {
    Random random(seed_, kScreens);
    const TextureRegion left = world_.add_texture(code_screen(1024, 512, false, random));
    const TextureRegion right = world_.add_texture(code_screen(1024, 512, true, random));
    add_monitor(place(-0.23, 0.27, 8, random), left, materials_, &world_);
    add_monitor(place(0.36, 0.27, -12, random), right, materials_, &world_);
  }

  void add_keyboard_and_mouse() {
    Random random(seed_, kSurfaces);
    const TextureRegion keys = world_.add_texture(keyboard(1024, 256, random));
    add_keyboard(place(0.0, -0.13, 2, random), keys, materials_, &world_);
    const TextureRegion cloth = world_.add_texture(fabric(256, 256, 4, 0.32F, random));
    add_mouse(place(0.37, -0.15, -5, random), cloth, materials_, &world_);
  }

  void add_books() {
    Random random(seed_, kBooks);
    double height = 0;
    for (int i = 0; i < 4; ++i) {  // a stack on the left
      const TextureRegion front = world_.add_texture(cover(256, 512, random));
      TextureRegion back = world_.add_texture(spine(64, 512, random));
      const double thickness = random.uniform(0.018, 0.04);
      const double turned = (is_moved_ ? -35 : 12) + random.uniform(-14.0, 14.0);
      const Placement at = place(is_moved_ ? -0.40 : -0.60, -0.02, turned, random, height);
      world_.add_box(at, {0.17 - 0.008 * i, 0.24 - 0.01 * i, thickness}, {materials_.light, back, front});
      height += thickness;
    }
    double x = 0.50;
    for (int i = 0; i < 8; ++i) {  // a row before the wall
      const TextureRegion back = world_.add_texture(spine(64, 512, random));
      const double thickness = random.uniform(0.018, 0.036);
      const Eigen::Vector3d size(thickness, 0.17, random.uniform(0.19, 0.27));
      world_.add_box({{x + 0.16 + thickness / 2, 0.33, 0}, 0}, size,
                     {back, materials_.dark, materials_.light});
      x += thickness + 0.001;
    }
  }

  void add_goods() {
    Random random(seed_, kGoods);
    const TextureRegion product = world_.add_texture(cover(256, 256, random));
    const TextureRegion other = world_.add_texture(cover(256, 256, random));
    // Two alike, as in a shop: what looks the same need not be the same place.
    world_.add_box(place(-0.68, 0.27, 20, random), {0.13, 0.10, 0.20}, all_sides(product));
    world_.add_box(place(0.56, 0.12, -25, random), {0.13, 0.10, 0.20}, all_sides(product));
    world_.add_box(place(-0.52, 0.22, -6, random), {0.10, 0.08, 0.12}, all_sides(other));
    const TextureRegion label = world_.add_texture(wrapped_label(512, 256, 0.3F, random));
    for (int i = 0; i < 4; ++i) {  // a row of tins
      world_.add_cylinder(place(0.10 + 0.085 * i, 0.10 + 0.008 * i, random.uniform(-30.0, 30.0), random),
                          0.036, 0.10, label, materials_.light);
    }
    const TextureRegion phone = world_.add_texture(code_screen(128, 256, false, random));
    const Placement at = place(0.56, -0.24, 15, random);
    world_.add_box(at, {0.075, 0.15, 0.009}, {materials_.dark, materials_.dark, phone});
    add_pen_pot(place(-0.40, 0.17, 0, random), product, materials_, random, &world_);
  }

  void add_mugs() {
    Random random(seed_, kMugs);
    const TextureRegion label = world_.add_texture(wrapped_label(512, 256, 0.82F, random));
    const std::pair first = is_moved_ ? std::pair(-0.66, -0.10) : std::pair(-0.34, -0.06);
    for (const auto& [x, y] : {first, {0.27, -0.02}, {0.66, -0.08}}) {
      const Placement at = place(x, y, random.uniform(-180.0, 180.0), random);
      add_mug(at, label, materials_, &world_);
    }
  }

  void add_print() {
    Random random(seed_, kPrint);
    std::array<TextureRegion, 4> pages;
    for (TextureRegion& page : pages) page = world_.add_texture(printed_page(512, 512, random));
    const std::array<Eigen::Vector3d, 6> places = {{{-0.33, -0.24, 18},
                                                    {-0.50, -0.25, -12},
                                                    {0.68, -0.27, -20},
                                                    {0.04, -0.29, -4},
                                                    {-0.68, -0.29, 8},
                                                    {0.47, -0.02, 60}}};
    double height = 0.0006;
    for (size_t i = 0; i < places.size(); ++i) {
      world_.add_sheet(place(places[i].x(), places[i].y(), places[i].z(), random, height), 0.21, 0.297,
                       pages[i % pages.size()]);
      height += 0.0004;
    }
  }

  void add_cables() {
    Random random(seed_, kCables);
    world_.add_cable(hanging_cable({0.0, -0.06, 0.012}, {-0.05, 0.38, 0.004}, 0.02, random), 0.005,
                     materials_.dark);
    world_.add_cable(hanging_cable({0.38, -0.08, 0.02}, {0.16, 0.38, 0.004}, 0.03, random), 0.004,
                     materials_.light);
    world_.add_cable(hanging_cable({-0.23, 0.31, 0.25}, {-0.42, 0.40, 0.01}, 0.1, random), 0.007,
                     materials_.dark);
    world_.add_cable(hanging_cable({0.36, 0.32, 0.25}, {0.10, 0.41, 0.01}, 0.1, random), 0.007,
                     materials_.dark);
  }

  /// Blank but for a poster and a field of notes, all alike.
  void add_wall() {
    Random random(seed_, kSurfaces + 100);
    Bitmap plaster = pink_noise(512, 512, 256, 5, 0.015F, random);
    for (int y = 0; y < plaster.height(); ++y) {
      for (int x = 0; x < plaster.width(); ++x) plaster.at(x, y) += 0.8F;
    }
    TextureRegion blank = world_.add_texture(plaster);
    blank.width *= 4;
    blank.height *= 2;
    world_.add_panel({-2.5, kWallY, kFloorZ}, {5, 0, 0}, {0, 0, 3}, blank);
    world_.add_panel({-2.5, -3, kFloorZ}, {0, 3 + kWallY, 0}, {0, 0, 3}, blank);
    world_.add_panel({2.5, kWallY, kFloorZ}, {0, -3 - kWallY, 0}, {0, 0, 3}, blank);
    const double y = kWallY - 0.002;
    world_.add_panel({-0.95, y, 0.32}, {0.42, 0, 0}, {0, 0, 0.55},
                     world_.add_texture(cover(512, 512, random)));
    Bitmap note(128, 128, 0.78F);
    note.paste(printed_page(104, 104, random), 12, 16);
    const TextureRegion notes = world_.add_texture(note);
    for (int row = 0; row < 2; ++row) {
      for (int column = 0; column < 4; ++column) {
        world_.add_panel({0.62 + 0.095 * column, y, 0.36 + 0.1 * row}, {0.076, 0, 0}, {0, 0, 0.076}, notes);
      }
    }
  }

  void add_desk_and_floor() {
    Random random(seed_, kSurfaces + 200);
    constexpr int kWidth = 2048;
    constexpr int kHeight = 1024;
    Bitmap top = wood(kWidth, kHeight, random);
    draw_cable_tangle(&top, 0.46F * kWidth, 0.2F * kHeight, 110, 4, random);
    draw_cable_tangle(&top, 0.83F * kWidth, 0.28F * kHeight, 90, 3, random);
    draw_cable_tangle(&top, 0.06F * kWidth, 0.42F * kHeight, 70, 3, random);
    world_.paint_shadows(&top, kDeskWidth, kDeskDepth);
    const TextureRegion desk = world_.add_texture(top);
    const Eigen::Vector3d corner(-kDeskWidth / 2, -kDeskDepth / 2, 0);
    world_.add_panel(corner, {kDeskWidth, 0, 0}, {0, kDeskDepth, 0}, desk);
    TextureRegion edge = desk;
    edge.height = 40;
    const Eigen::Vector3d down(0, 0, -0.03);
    world_.add_panel(corner + down, {kDeskWidth, 0, 0}, -down, edge);
    TextureRegion floor = world_.add_texture(carpet(512, 512, random));
    floor.width *= 5;
    floor.height *= 4;
    world_.add_panel({-2.5, -3, kFloorZ}, {5, 0, 0}, {0, 3 + kWallY, 0}, floor);
  }

  /// The route: from a start before the keyboard, aside as one starts a map, then over the whole desk, near
  /// and far, and back.
  std::vector<Waypoint> make_route() const {
    const Waypoint start{{-0.03, -0.62, 0.42}, {0.0, 0.02, 0.02}};
    const std::array<Waypoint, 12> stations = {{
        {{-0.38, -0.58, 0.42}, {-0.42, 0.05, 0.04}},   // left, pages and books
        {{-0.52, -0.44, 0.32}, {-0.58, 0.12, 0.08}},   // closer
        {{-0.20, -0.40, 0.36}, {-0.22, 0.22, 0.20}},   // left monitor
        {{0.08, -0.72, 0.62}, {0.04, 0.05, 0.06}},     // far, all
        {{0.40, -0.52, 0.38}, {0.42, 0.08, 0.10}},     // right, mugs and tins
        {{0.56, -0.42, 0.30}, {0.62, 0.20, 0.12}},     // books on the right
        {{0.30, -0.40, 0.34}, {0.34, 0.24, 0.22}},     // right monitor
        {{0.10, -0.36, 0.50}, {0.08, 0.02, 0.00}},     // keyboard from above
        {{-0.10, -0.66, 0.40}, {-0.02, 0.08, 0.06}},   // back at the start
        {{0.46, -0.66, 0.56}, {0.22, 0.06, 0.04}},     // from the right
        {{-0.48, -0.66, 0.58}, {-0.24, 0.06, 0.06}},   // from the left
        {{-0.30, -0.38, 0.48}, {-0.34, -0.06, 0.00}},  // pages from above
    }};
    Random random(seed_, kRoute);
    const auto shaken = [&random](Waypoint view) {
      for (int axis = 0; axis < 3; ++axis) {
        view.eye[axis] += 0.035 * random.normal();
        view.target[axis] += 0.03 * random.normal();
      }
      return view;
    };
    std::vector<Waypoint> route(3, start);
    const Eigen::Vector3d aside(0.14, 0, 0);
    for (const double part : {0.6, 1.0, 0.6, 0.0}) {
      route.push_back({start.eye + part * aside, start.target + 0.5 * part * aside});
    }
    Waypoint last = start;
    for (size_t leg = 0; leg < 28; ++leg) {
      const Waypoint& next = leg < stations.size()
                                 ? stations[leg]
                                 : stations[static_cast<size_t>(random.integer(0, stations.size() - 1))];
      for (const double part : {0.33, 0.67, 1.0}) {
        route.push_back(shaken(
            {last.eye + part * (next.eye - last.eye), last.target + part * (next.target - last.target)}));
      }
      last = next;
    }
    route.push_back({0.5 * (last.eye + start.eye), 0.5 * (last.target + start.target)});
    return route;
  }

  ScenarioOptions options_;
  uint64_t seed_;
  bool is_moved_;
  WorldBuilder world_;
  Materials materials_;
};

}  // namespace

Scenario make_desk(const ScenarioOptions& options) {
  return DeskBuilder(options, "desk", false).build();
}

Scenario make_desk_moved(const ScenarioOptions& options) {
  return DeskBuilder(options, "desk-moved", true).build();
}

}  // namespace cairn
