// SPDX-License-Identifier: Apache-2.0
// What the scenarios of losing and holding on were made for: angles, speeds, what lies still, what repeats.
#include "tests/world/hold.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "common/image/corners.h"
#include "tests/world/bays.h"
#include "tests/world/columns.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kFrame = 1 / kSimulatorFrameRate;

Simulator made(std::string_view name, const SimulatorOptions& options = {}) {
  return Simulator::make(name, options).value();
}

double degrees_between(const SE3& a, const SE3& b) {
  return a.rotation().angularDistance(b.rotation()) * kDegrees;
}

/// The greatest speed within a turn [degrees/s], hand and all.
double peak_of(const Simulator& simulator, const Turn& turn) {
  double peak = 0;
  for (double t = turn.begin; t < turn.begin + turn.going; t += kFrame) {
    peak = std::max(peak, degrees_between(simulator.map_from_camera(t), simulator.map_from_camera(t + 1e-3)));
  }
  return peak * 1e3;
}

class Holding : public ::testing::TestWithParam<std::string_view> {};
INSTANTIATE_TEST_SUITE_P(Scenarios, Holding,
                         ::testing::Values("pan", "roll", "look-away", "watermark", "border", "rush",
                                           "outage", "bays", "columns"),
                         [](const auto& info) {
                           std::string name(info.param);
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(Holding, TruthHasNoJumps) {
  const auto simulator = made(GetParam(), {.speed = 3});
  // Halving the step quarters the second difference of a curve that is twice continuously differentiable.
  for (double t = 0.1; t < std::min(33.0, simulator.frame_count() * kFrame); t += 0.07) {
    const auto second = [&](double h) -> Eigen::Vector3d {
      return simulator.map_from_camera(t + h).translation() - 2 * simulator.map_from_camera(t).translation() +
             simulator.map_from_camera(t - h).translation();
    };
    EXPECT_LT((second(1e-3) / 1e-6 - second(5e-4) / 2.5e-7).norm(), 5) << "at " << t;
    EXPECT_LT(degrees_between(simulator.map_from_camera(t - 1e-4), simulator.map_from_camera(t + 1e-4)), 0.2)
        << "at " << t;
  }
}

TEST_P(Holding, BeginsWithParallaxAndShowsSomething) {
  auto simulator = made(GetParam());
  const SE3 start = simulator.map_from_camera(0.3);
  double widest = 0;
  for (double t = 0.3; t < 4; t += 0.1) {
    const Eigen::Vector3d moved = start.inverse() * simulator.map_from_camera(t).translation();
    widest = std::max(widest, std::abs(moved.x()));
  }
  const double depth = simulator.view(9).depth;
  EXPECT_GT(depth, 0.3);
  EXPECT_LT(depth, 6);
  EXPECT_GT(widest, 0.05 * depth);
  CornerList corners;
  detect_fast10(simulator.frame(60).image.view(), 10, &corners);
  EXPECT_GT(corners.corners.size(), 600u);
}

TEST(Pan, GoesNinetyDegreesAwayFasterAndFasterAndComesBack) {
  const Scenario scenario = make_pan({});
  const auto simulator = made("pan");
  std::multiset<double> peaks;
  for (const Turn& turn : scenario.turns) {
    const double middle = turn.begin + turn.going + turn.staying / 2;
    EXPECT_EQ(turn.staying, 2);
    EXPECT_NEAR(degrees_between(simulator.map_from_camera(turn.begin), simulator.map_from_camera(middle)), 90,
                8);
    EXPECT_LT(degrees_between(simulator.map_from_camera(turn.begin), simulator.map_from_camera(turn.end())),
              8);
    peaks.insert(std::round(peak_of(simulator, turn) / 30) * 30);
  }
  EXPECT_EQ(peaks, (std::multiset<double>{60, 90, 120, 150}));
}

TEST(Pan, EndsWhereThereIsMuchToSeeAndNotTheDesk) {
  const Turn turn = make_pan({}).turns.front();
  auto simulator = made("pan");
  const int frame = static_cast<int>((turn.begin + turn.going + 1) * kSimulatorFrameRate);
  CornerList corners;
  detect_fast10(simulator.frame(frame).image.view(), 10, &corners);
  EXPECT_GT(corners.corners.size(), 1000u);
  const Eigen::Vector3d desk = simulator.map_from_camera(frame * kFrame).inverse().translation();
  EXPECT_LT(desk.z(), desk.head<2>().norm());  // its middle is 45 degrees from the optical axis and more
}

TEST(Roll, IsAboutTheOpticalAxisToEitherSide) {
  const auto simulator = made("roll");
  std::multiset<int> signs;
  for (const Turn& turn : make_roll({}).turns) {
    const SE3 before = simulator.map_from_camera(turn.begin);
    const SE3 there = simulator.map_from_camera(turn.begin + turn.going + turn.staying / 2);
    const Eigen::Vector3d moved = so3_log(before.rotation().conjugate() * there.rotation()) * kDegrees;
    EXPECT_NEAR(std::abs(moved.z()), 60, 6);
    EXPECT_LT(moved.head<2>().norm(), 8);
    signs.insert(moved.z() > 0 ? 1 : -1);
  }
  EXPECT_EQ(signs, (std::multiset<int>{-1, -1, 1, 1}));
}

size_t corners_at(Simulator* simulator, const Turn& turn) {
  const GrayImage image =
      simulator->frame(static_cast<int>((turn.begin + turn.going + 1) * kSimulatorFrameRate)).image;
  CornerList corners;
  detect_fast10(image.view(), 15, &corners);
  return corners.corners.size();
}

TEST(LookAway, ShowsABlankWallAndTheWaterMarkIsAllThereIsOnIt) {
  const Turn turn = make_look_away({}).turns.front();
  auto plain = made("look-away");
  auto marked = made("watermark");
  EXPECT_LT(corners_at(&plain, turn), 10u);
  EXPECT_GT(corners_at(&marked, turn), 60u);
}

/// Pixels of the upper left part that differ by more than noise between two frames far apart.
int changed(const GrayImage& a, const GrayImage& b, const Bitmap& opacity) {
  int count = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      if (opacity.at(x, y) > 0.999F && std::abs(a.row(y)[x] - b.row(y)[x]) > 1) ++count;
    }
  }
  return count;
}

TEST(Border, IsRoundAndStandsStillWhileTheRestMoves) {
  const Scenario scenario = make_border({});
  auto simulator = made("border");
  const GrayImage first = simulator.frame(0).image;
  const GrayImage later = simulator.frame(240).image;
  ASSERT_TRUE(scenario.overlay);
  EXPECT_EQ(changed(first, later, scenario.overlay->opacity), 0);
  EXPECT_GT(changed(first, later, Bitmap(first.width(), first.height(), 1)), 100000);
  const Bitmap& opacity = scenario.overlay->opacity;
  for (const auto& [x, y] : {std::pair{0, 0}, {639, 0}, {0, 479}, {639, 479}, {5, 211}, {635, 211}}) {
    EXPECT_EQ(opacity.at(x, y), 1) << x << ' ' << y;
  }
  for (const auto& [x, y] : {std::pair{313, 211}, {313, 2}, {100, 211}}) {
    EXPECT_EQ(opacity.at(x, y), 0) << x << ' ' << y;
  }
}

TEST(Rush, BeginsCalmAndIsThenAsFastAsAsked) {
  const auto calm = made("desk");
  const auto rush = made("rush", {.frames = 900, .speed = 3});
  for (double t = 0; t < 8; t += 0.5) {
    EXPECT_LT((calm.map_from_camera(t).inverse() * rush.map_from_camera(t)).log().norm(), 1e-12) << t;
  }
  // The clock lost 8.5 s of three times the speed while it was calm: two thirds of them on the route.
  const auto distance = [](const Simulator& simulator, double begin, double end) {
    double sum = 0;
    for (double t = begin; t < end; t += 0.01) {
      sum += (simulator.map_from_camera(t + 0.01).translation() - simulator.map_from_camera(t).translation())
                 .norm();
    }
    return sum;
  };
  const double route = 3 * (20 - 8.5) + 8.5;
  EXPECT_NEAR(distance(rush, 9, 20) / distance(calm, 9 + 1, route), 1, 0.15);
}

TEST(RouteClock, IsInvertedExactly) {
  for (const RouteClock clock : {RouteClock{1, 0}, {3, 0}, {3, 8}, {0.5, 8}, {5, 2}}) {
    for (double t = 0; t < 30; t += 0.37) EXPECT_NEAR(clock.seconds_at(clock.at(t)), t, 1e-9);
  }
}

TEST(Outage, AlwaysGoesToWhatIsNewAtAWalkersPace) {
  const auto simulator = made("outage");
  double fastest = 0;
  double fastest_turn = 0;
  for (double t = 4; t < simulator.frame_count() * kFrame - 2; t += 0.1) {
    const SE3 now = simulator.map_from_camera(t);
    const SE3 then = simulator.map_from_camera(t + 0.5);
    fastest = std::max(fastest, 2 * (then.translation() - now.translation()).norm());
    fastest_turn = std::max(fastest_turn, 2 * degrees_between(now, then));
  }
  EXPECT_LT(fastest, 0.6);
  EXPECT_LT(fastest_turn, 50);
  // It has turned away from all that the first six seconds show.
  for (const int frame : {14 * 30, 30 * 30}) {
    const SE3 there = simulator.map_from_camera(frame * kFrame);
    EXPECT_GT(degrees_between(simulator.map_from_camera(6), there), frame > 500 ? 90 : 20);
  }
  EXPECT_GT(simulator.frame_count() * kFrame, 36);
}

TEST(Bays, AreEqual) {
  const Scenario scenario = make_bays({});
  int repeated = 0;
  for (const Face& face : scenario.faces) {
    if (face.corners.front().y() < 0 || face.corners.front().y() > 10 || face.corners.front().z() < -1)
      continue;
    const bool found = std::ranges::any_of(scenario.faces, [&](const Face& other) {
      return other.texture == face.texture &&
             (other.corners.front() - face.corners.front() - Eigen::Vector3d(0, kBay, 0)).norm() < 1e-9;
    });
    EXPECT_TRUE(found) << face.corners.front().transpose();
    ++repeated;
  }
  EXPECT_GT(repeated, 100);
}

TEST(Bays, AreWalkedAlong) {
  const auto simulator = made("bays");
  const double end = simulator.frame_count() * kFrame - 2;
  const Eigen::Vector3d walked =
      simulator.map_from_camera(end).translation() - simulator.map_from_camera(6).translation();
  EXPECT_GT(walked.y(), 10 * kBay);
  EXPECT_NEAR(walked.y() / (end - 6), 1.4, 0.1);
}

TEST(Columns, StillsAreEvenlySpacedRoundOneObject) {
  auto simulator = made("columns", {.frames = 48, .blur = 0, .speed = 6});
  for (int i = 0; i + 2 < 48; ++i) {
    const SE3 a = simulator.map_from_camera(i * kFrame);
    const SE3 b = simulator.map_from_camera((i + 2) * kFrame);
    const double turned =
        std::atan2(a.translation().x() * b.translation().y() - a.translation().y() * b.translation().x(),
                   a.translation().head<2>().dot(b.translation().head<2>()));
    EXPECT_NEAR(turned * kDegrees, 15, 1.5) << i;
  }
  const GrayImage image = simulator.frame(0).image;
  for (const auto& [x, y] : {std::pair{5, 5}, {634, 5}, {5, 474}, {634, 474}}) EXPECT_LT(image.row(y)[x], 12);
}

}  // namespace
}  // namespace cairn
