// SPDX-License-Identifier: Apache-2.0
// What holds of every scenario, and what each was made for.
#include "tests/world/scenario.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "common/io/test_directory.h"
#include "tests/world/annotation.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

double mean_of(const GrayImage& image) {
  double sum = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) sum += image.row(y)[x];
  }
  return sum / (image.width() * image.height());
}

class EveryScenario : public ::testing::TestWithParam<std::string_view> {
 protected:
  static Scenario make(const ScenarioOptions& options) { return make_scenario(GetParam(), options).value(); }
};
INSTANTIATE_TEST_SUITE_P(Scenarios, EveryScenario,
                         ::testing::Values("desk", "desks", "laboratory", "building"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(EveryScenario, LightLeavesGeometryAndRoute) {
  constexpr uint64_t seed = 3;
  const Scenario morning = make({.seed = seed});
  const Scenario later = make({.seed = seed, .daytime = Daytime::kLater});
  // The sun's patches, two panes a place at most, come on top and belong to no shared face: all others must
  // be there, in order.
  size_t next = 0;
  size_t darker_or_brighter = 0;
  for (const Face& face : later.faces) {
    if (next < morning.faces.size() && face.corners == morning.faces[next].corners) {
      EXPECT_EQ(face.place, morning.faces[next].place);
      EXPECT_EQ(face.body, morning.faces[next].body);
      if (face.brightness != morning.faces[next].brightness) ++darker_or_brighter;
      ++next;
    }
  }
  EXPECT_EQ(next, morning.faces.size()) << "seed " << seed;
  EXPECT_LE(later.faces.size() - morning.faces.size(), 2 * morning.places.size()) << "seed " << seed;
  EXPECT_GT(darker_or_brighter, morning.faces.size() / 2);
  ASSERT_EQ(later.route.size(), morning.route.size());
  for (size_t i = 0; i < later.route.size(); ++i) {
    EXPECT_EQ(later.route[i].eye, morning.route[i].eye);
    EXPECT_EQ(later.route[i].target, morning.route[i].target);
  }
}

TEST(DeskMoved, IsTheDeskButForAFewThings) {
  const Scenario before = make_scenario("desk", {.seed = 3}).value();
  const Scenario after = make_scenario("desk-moved", {.seed = 3}).value();
  ASSERT_EQ(after.faces.size(), before.faces.size());
  size_t moved = 0;
  for (size_t i = 0; i < after.faces.size(); ++i) {
    if (after.faces[i].corners != before.faces[i].corners) ++moved;
    EXPECT_EQ(after.faces[i].texture, before.faces[i].texture);
  }
  EXPECT_GT(moved, 4 * 5U) << "four books have five sides each";
  EXPECT_LT(moved, after.faces.size() / 4);
  ASSERT_EQ(after.route.size(), before.route.size());
  for (size_t i = 0; i < after.route.size(); ++i) EXPECT_EQ(after.route[i].eye, before.route[i].eye);
}

TEST_P(EveryScenario, PhasesHaveNoGapsAndLookAtTheirPlaces) {
  for (const std::string_view camera : {"hand", "shoulder"}) {
    SimulatorOptions options;
    ASSERT_TRUE(options.set_option("camera", camera));
    const auto simulator = Simulator::make(GetParam(), options).value();
    const std::vector<Phase> phases = simulator.phases();
    ASSERT_FALSE(phases.empty());
    EXPECT_EQ(phases.front().begin, 0);
    for (size_t i = 0; i + 1 < phases.size(); ++i) EXPECT_EQ(phases[i].end, phases[i + 1].begin);
    for (const Phase& phase : phases) {
      ASSERT_LT(phase.begin, phase.end);
      if (phase.kind == PhaseKind::kWalk) continue;
      const int middle = static_cast<int>((phase.begin + phase.end) / 2 * kSimulatorFrameRate);
      const SimView view = simulator.view(std::min(middle, simulator.frame_count() - 1));
      double share = 0;
      for (const auto& seen : view.places) {
        if (seen.place == phase.place) share = seen.share;
      }
      EXPECT_GT(share, 0.2) << camera << ": " << to_string(phase.kind) << ' '
                            << simulator.places()[static_cast<size_t>(phase.place)].name;
    }
  }
}

TEST_P(EveryScenario, WhatIsMappedIsVisitedAfterSomethingElse) {
  for (const uint64_t seed : {1, 2}) {
    const Scenario scenario = make({.seed = seed});
    if (scenario.endless) continue;  // one place, no visits
    std::set<int> mapped;
    std::set<int> visited;
    int here = -1;
    for (const Phase& phase : scenario.phases) {
      if (phase.kind == PhaseKind::kWalk) continue;
      EXPECT_NE(phase.place, here) << "seed " << seed;
      here = phase.place;
      (phase.kind == PhaseKind::kMap ? mapped : visited).insert(phase.place);
    }
    EXPECT_TRUE(std::ranges::includes(visited, mapped)) << "seed " << seed;
    EXPECT_EQ(visited.size(), scenario.places.size()) << "seed " << seed;
    const Scenario second = make({.seed = seed, .session = Session::kVisit});
    EXPECT_TRUE(
        std::ranges::none_of(second.phases, [](const Phase& p) { return p.kind == PhaseKind::kMap; }));
  }
}

TEST_P(EveryScenario, WalksCanBeDarkAndNothingElse) {
  SimulatorOptions options;
  options.session = Session::kVisit;
  options.walks = Walks::kDark;
  const auto covered = Simulator::make(GetParam(), options).value();
  for (const Phase& phase : covered.phases()) {
    const int middle = static_cast<int>((phase.begin + phase.end) / 2 * kSimulatorFrameRate);
    if (middle >= covered.frame_count()) continue;
    EXPECT_EQ(covered.view(middle).dark, phase.kind == PhaseKind::kWalk) << phase.begin;
  }
}

/// The most by which the camera moves [m] and turns [degrees] within half a second of the ways between
/// places.
std::pair<double, double> most_on_walks(Walks how) {
  SimulatorOptions options;
  options.session = Session::kMap;
  options.walks = how;
  const auto walking = Simulator::make("desks", options).value();
  double metres = 0;
  double degrees = 0;
  for (const Phase& phase : walking.phases()) {
    if (phase.kind != PhaseKind::kWalk) continue;
    for (double begin = phase.begin; begin + 0.5 < phase.end; begin += 0.1) {
      const SE3 moved = walking.map_from_camera(begin).inverse() * walking.map_from_camera(begin + 0.5);
      metres = std::max(metres, moved.translation().norm());
      degrees = std::max(degrees, Eigen::AngleAxisd(moved.rotation()).angle() * 180 / std::numbers::pi);
    }
  }
  return {metres, degrees};
}

TEST(Desks, SlowWalksAreSlowAndKeepTheView) {
  const auto [slow_metres, slow_degrees] = most_on_walks(Walks::kSlow);
  EXPECT_LT(slow_metres, 0.5);
  EXPECT_LT(slow_degrees, 30);
  const auto [metres, degrees] = most_on_walks(Walks::kBrisk);
  EXPECT_GT(metres, 0.7);
  EXPECT_GT(degrees, 45);
}

TEST(Desks, TwelveOfFifteenAreMapped) {
  const Scenario scenario = make_scenario("desks", {.seed = 3}).value();
  EXPECT_EQ(scenario.places.size(), 15u);
  EXPECT_EQ(std::ranges::count(scenario.phases, PhaseKind::kMap, &Phase::kind), 12);
  EXPECT_EQ(std::ranges::count(scenario.phases, PhaseKind::kVisit, &Phase::kind), 15);
}

TEST(Laboratory, RobotIsMovedBetweenVisitsAndItsPlaceWithIt) {
  const auto simulator = Simulator::make("laboratory", {.session = Session::kVisit}).value();
  const auto annotation = annotate(simulator);
  std::vector<SE3> stands;
  for (const auto& phase : annotation.phases) {
    if (phase.kind != PhaseKind::kVisit || annotation.places[static_cast<size_t>(phase.place)] != "robot") {
      continue;
    }
    std::optional<SE3> first;
    for (const auto& frame : annotation.frames) {
      if (frame.time < phase.begin || frame.time >= phase.end) continue;
      for (const auto& share : frame.shares) {
        if (share.place != phase.place) continue;
        if (!first) first = share.map_from_place;
        // At rest while it is looked at.
        EXPECT_LT((share.map_from_place.translation() - first->translation()).norm(), 1e-9);
      }
    }
    ASSERT_TRUE(first);
    stands.push_back(*first);
  }
  ASSERT_EQ(stands.size(), 4u);
  EXPECT_LT((stands[0].translation() - stands[1].translation()).norm(), 1e-9);
  EXPECT_GT((stands[1].translation() - stands[2].translation()).norm(), 1);
  EXPECT_GT(stands[1].rotation().angularDistance(stands[2].rotation()), 0.3);
  EXPECT_LT((stands[2].translation() - stands[3].translation()).norm(), 1e-9);
}

TEST(Building, PlacesLieOnThreeFloors) {
  const Scenario scenario = make_scenario("building", {}).value();
  std::set<int> floors;
  for (const Place& place : scenario.places) {
    floors.insert(static_cast<int>(place.body_from_place.translation().z() / 3));
  }
  EXPECT_EQ(scenario.places.size(), 5u);
  EXPECT_EQ(floors.size(), 3u);
}

/// A white square of a body of its own before black nothing.
Scenario gliding_square() {
  Scenario scenario;
  scenario.camera =
      make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, 0, 0, 0, 0, 0}}).value();
  scenario.textures.emplace_back(Bitmap(8, 8, 1.0F));
  scenario.route = std::vector<Waypoint>(8, {{0, -1, 0}, {0, 0, 0}});
  scenario.phases = {{PhaseKind::kMap, 0, 0, 4.8}};
  scenario.places = {{"square", 1, SE3()}};
  Body body;
  body.glides = {{1, 2, SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, 0, 0))}};
  scenario.bodies.push_back(body);
  Face face = make_face({-0.05, 0, -0.05}, {0.1, 0, 0}, {0, 0, 0.1}, {0, 0, 0, 8, 8}, 1.0F);
  face.body = 1;
  face.place = 0;
  scenario.faces.push_back(face);
  return scenario;
}

Eigen::Vector2d bright_centroid(const GrayImage& image) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double weight = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      sum += image.row(y)[x] * Eigen::Vector2d(x, y);
      weight += image.row(y)[x];
    }
  }
  return sum / weight;
}

TEST(MovingBody, IsRenderedWhereItsPoseSays) {
  SimulatorOptions options;
  options.noise = 0;
  options.blur = 0;
  options.exposure = 0;
  Simulator simulator(gliding_square(), options);
  for (const int i : {10, 40, 45, 50, 80}) {
    const SimFrame frame = simulator.frame(i);
    const SimView view = simulator.view(i);
    ASSERT_EQ(view.places.size(), 1u) << i;
    const Eigen::Vector3d centre = view.places[0].map_from_place.translation();
    EXPECT_NEAR(centre.x(), i < 30 ? 0 : i > 60 ? 0.3 : centre.x(), 1e-12);
    const auto expected = simulator.camera().project(frame.map_from_camera.inverse() * centre);
    ASSERT_TRUE(expected);
    EXPECT_LT((bright_centroid(frame.image) - *expected).norm(), 0.5) << i;  // the square is seen at a slant
  }
}

TEST(MovingBody, GlidesSmoothlyBetweenStations) {
  Body body;
  body.glides = {{1, 2, SE3(so3_exp({0, 0, 1.0}), Eigen::Vector3d(1, 0, 0))},
                 {3, 5, SE3(so3_exp({0, 0, 0.2}), Eigen::Vector3d(1, 2, 0))}};
  EXPECT_EQ(body.at(0.5).translation(), Eigen::Vector3d::Zero());
  EXPECT_LT((body.at(2.5).translation() - Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((body.at(7).translation() - Eigen::Vector3d(1, 2, 0)).norm(), 1e-12);
  EXPECT_NEAR(body.at(7).rotation().angularDistance(so3_exp({0, 0, 0.2})), 0, 1e-7);
  for (double t = 0; t < 6; t += 0.01) {
    EXPECT_LT((body.at(t + 0.01).translation() - body.at(t).translation()).norm(), 0.03) << t;
  }
}

TEST(EventTrain, HasItsRateAndDurationAndQuietBeginning) {
  for (const double per_minute : {2.0, 6.0, 15.0}) {
    constexpr double kDuration = 0.6;
    const EventTrain train(per_minute, kDuration, 7, 1);
    std::set<uint64_t> events;
    double busy = 0;
    for (double t = 0; t < 606; t += 0.01) {
      const auto moment = train.at(t);
      if (!moment) continue;
      EXPECT_GE(t, 6);
      EXPECT_GE(moment->part, 0);
      EXPECT_LT(moment->part, 1);
      events.insert(moment->event);
      busy += 0.01;
    }
    EXPECT_NEAR(static_cast<double>(events.size()), 10 * per_minute, 1) << per_minute;
    EXPECT_NEAR(busy, 10 * per_minute * kDuration, 2 * kDuration) << per_minute;
  }
  EXPECT_FALSE(EventTrain(0, 1, 1, 1).at(100));
}

/// Every fifth frame of a disturbed run beside the same run undisturbed.
struct Disturbed {
  int dark = 0;
  int hidden = 0;   ///< the place's share falls below half of what it was, not dark
  int turned = 0;   ///< by more than 10 degrees
  double most = 0;  ///< degrees
};
Disturbed compare(const SimulatorOptions& options) {
  SimulatorOptions plain;
  plain.frames = options.frames;
  const auto quiet = Simulator::make("desk", plain).value();
  const auto disturbed = Simulator::make("desk", options).value();
  Disturbed result;
  for (int i = 0; i < options.frames; i += 5) {
    const SimView view = disturbed.view(i);
    const double before = quiet.view(i).places.front().share;
    const double now = view.places.empty() ? 0 : view.places.front().share;
    result.dark += view.dark ? 1 : 0;
    result.hidden += !view.dark && now < before / 2 ? 1 : 0;
    const double t = quiet.time(i).seconds();
    const double turn =
        quiet.map_from_camera(t).rotation().angularDistance(disturbed.map_from_camera(t).rotation()) *
        57.2958;
    result.turned += turn > 10 ? 1 : 0;
    result.most = std::max(result.most, turn);
  }
  return result;
}

TEST(Disturbance, HandsHideBlackoutsDarkenJerksTurn) {
  SimulatorOptions options;
  options.frames = 900;
  const Disturbed none = compare(options);
  EXPECT_EQ(none.dark + none.hidden + none.turned, 0);
  options.hands = 10;
  const Disturbed hands = compare(options);
  EXPECT_GT(hands.hidden, 10);  // 4 events of 1.2 s: 29 of the 180 looked at
  EXPECT_LT(hands.hidden, 32);
  EXPECT_EQ(hands.dark + hands.turned, 0);
  options.hands = 0;
  options.blackouts = 10;
  const Disturbed blackouts = compare(options);
  EXPECT_NEAR(blackouts.dark, 4 * 3, 4);
  EXPECT_EQ(blackouts.hidden + blackouts.turned, 0);
  options.blackouts = 0;
  options.jerks = 10;
  const Disturbed jerks = compare(options);
  EXPECT_GT(jerks.turned, 2);
  EXPECT_EQ(jerks.dark, 0);
  EXPECT_LT(jerks.most, 25.1);
  EXPECT_GT(jerks.most, 12);  // of up to 25, less where it tilts
}

TEST(Disturbance, BlackoutIsBlackAndLaterIsAnotherLight) {
  SimulatorOptions options;
  options.frames = 400;
  options.blackouts = 15;
  auto simulator = Simulator::make("desk", options).value();
  int dark = 0;
  while (dark < options.frames && !simulator.view(dark).dark) ++dark;
  ASSERT_LT(dark, options.frames);
  EXPECT_LT(mean_of(simulator.frame(dark).image), 3);
  EXPECT_GT(mean_of(simulator.frame(dark - 1).image), 30);
  options = {.daytime = Daytime::kLater, .frames = 400};
  auto later = Simulator::make("desk", options).value();
  const double change = mean_of(later.frame(100).image) / mean_of(simulator.frame(100).image);
  EXPECT_GT(std::abs(change - 1), 0.05);
}

class AnnotationFiles : public ::testing::Test {
 protected:
  TestDirectory folder_;
  const std::filesystem::path& directory_ = folder_.path();
};

TEST_F(AnnotationFiles, AreReadAsWritten) {
  const auto simulator = Simulator::make("laboratory", {.session = Session::kVisit, .blackouts = 10}).value();
  const Annotation written = annotate(simulator);
  ASSERT_TRUE(write_annotation(directory_, written));
  const Annotation read = read_annotation(directory_).value();
  const auto name = [](const Annotation& a, int place) { return a.places[static_cast<size_t>(place)]; };
  ASSERT_EQ(read.frames.size(), written.frames.size());
  int empty = 0;
  for (size_t i = 0; i < read.frames.size(); ++i) {
    EXPECT_LE(std::abs((read.frames[i].time - written.frames[i].time).count()), 1000);
    ASSERT_EQ(read.frames[i].shares.size(), written.frames[i].shares.size());
    empty += read.frames[i].shares.empty() ? 1 : 0;
    for (size_t k = 0; k < read.frames[i].shares.size(); ++k) {
      const auto& a = read.frames[i].shares[k];
      const auto& b = written.frames[i].shares[k];
      EXPECT_EQ(name(read, a.place), name(written, b.place));
      EXPECT_NEAR(a.share, b.share, 1e-4);
      EXPECT_LT((a.map_from_place.inverse() * b.map_from_place).log().norm(), 1e-7);
    }
  }
  EXPECT_GT(empty, 0);  // blackouts
  ASSERT_EQ(read.phases.size(), written.phases.size());
  for (size_t i = 0; i < read.phases.size(); ++i) {
    EXPECT_EQ(read.phases[i].kind, written.phases[i].kind);
    EXPECT_EQ(name(read, read.phases[i].place), name(written, written.phases[i].place));
    EXPECT_LE(std::abs((read.phases[i].begin - written.phases[i].begin).count()), 1000);
  }
}

TEST_F(AnnotationFiles, DamageIsNamedWithItsLine) {
  const auto simulator = Simulator::make("desk", {.frames = 3}).value();
  ASSERT_TRUE(write_annotation(directory_, annotate(simulator)));
  std::ofstream(directory_ / "places.txt", std::ios::app) << "0.5 desk nonsense\n";
  const auto read = read_annotation(directory_);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kDamaged);
  EXPECT_NE(read.error().message.find("places.txt:6"), std::string::npos) << read.error().message;
  std::filesystem::remove(directory_ / "phases.txt");
  EXPECT_EQ(read_annotation(directory_).error().code, ErrorCode::kNotFound);
}

}  // namespace
}  // namespace cairn
