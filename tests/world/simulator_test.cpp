// SPDX-License-Identifier: Apache-2.0
#include "tests/world/simulator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "common/image/corners.h"

namespace cairn {
namespace {

SimulatorOptions plain_options() {
  SimulatorOptions options;
  options.noise = 0;
  options.blur = 0;
  options.exposure = 0;
  return options;
}

bool same(const GrayImage& a, const GrayImage& b) {
  for (int y = 0; y < a.height(); ++y) {
    if (std::memcmp(a.row(y), b.row(y), static_cast<size_t>(a.width())) != 0) return false;
  }
  return a.width() == b.width() && a.height() == b.height();
}

double mean_of(const GrayImage& image) {
  double sum = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) sum += image.row(y)[x];
  }
  return sum / (image.width() * image.height());
}

/// Mean squared difference of horizontal neighbours.
double sharpness(const GrayImage& image) {
  double sum = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 1; x < image.width(); ++x) {
      const int difference = image.row(y)[x] - image.row(y)[x - 1];
      sum += difference * difference;
    }
  }
  return sum / (image.width() * image.height());
}

/// Without bias and noise it would be exact: both are small against a hand's turns and against gravity.
TEST(SimImu, MeasuresHowTheCameraTurnsAndWhatHoldsItUp) {
  SimulatorOptions options = plain_options();
  options.imu = 200;
  const auto simulator = Simulator::make("rush", options);
  ASSERT_TRUE(simulator);
  const Eigen::Quaterniond camera_from_imu = simulator->imu()->camera_from_imu().rotation();
  Eigen::Quaterniond turned = simulator->map_from_camera(0).rotation();
  Eigen::Vector3d held = Eigen::Vector3d::Zero();
  for (int i = 0; i < 400; ++i) {
    const SimImuSample sample = simulator->imu_sample(i);
    EXPECT_EQ(sample.time, Timestamp::from_seconds(i / 200.0));
    turned = turned * so3_exp(camera_from_imu * sample.rate / 200);
    held += simulator->map_from_camera(i / 200.0).rotation() * (camera_from_imu * sample.acceleration) / 400;
  }
  EXPECT_LT(so3_log(turned.conjugate() * simulator->map_from_camera(2).rotation()).norm(), 0.1);
  EXPECT_LT((held - Eigen::Vector3d(0, 0, 9.80665)).norm(), 1.5);
  EXPECT_EQ(simulator->imu_sample(7).rate, simulator->imu_sample(7).rate) << "a pure function of its index";
  EXPECT_FALSE(Simulator::make("rush", plain_options())->imu());
}

struct CornerStatistics {
  int count = 0;           ///< pixels that are corners, not suppressed
  double empty_share = 0;  ///< share of 32x32 px blocks without any
};
CornerStatistics find_corners(const GrayImage& image) {
  constexpr int kBlock = 32;
  const int columns = image.width() / kBlock;
  const int rows = image.height() / kBlock;
  std::vector<int> block_counts(static_cast<size_t>(columns * rows), 0);
  CornerStatistics statistics;
  CornerList corners;
  detect_fast10(image.view(), 10, &corners);
  for (const auto [x, y] : corners.corners) {
    if (x >= columns * kBlock || y >= rows * kBlock) continue;
    ++statistics.count;
    ++block_counts[static_cast<size_t>(y / kBlock * columns + x / kBlock)];
  }
  const auto empty = std::count(block_counts.begin(), block_counts.end(), 0);
  statistics.empty_share = static_cast<double>(empty) / static_cast<double>(block_counts.size());
  return statistics;
}

TEST(SimulatorOptions, SetsEveryOptionThatItNames) {
  for (const auto& help : SimulatorOptions::help()) {
    SimulatorOptions options;
    const std::string value = help.key == "camera"     ? "shoulder"
                              : help.key == "light"    ? "later"
                              : help.key == "session"  ? "visit"
                              : help.key == "walks"    ? "dark"
                              : help.key == "exposure" ? "0.5"
                              : help.key == "imu"      ? "200"
                                                       : "1";
    EXPECT_TRUE(options.set_option(help.key, value)) << help.key;
    const auto refused = options.set_option(help.key, "-3x");
    ASSERT_FALSE(refused) << help.key;
    EXPECT_EQ(refused.error().code, ErrorCode::kUsage);
    EXPECT_NE(refused.error().message.find(help.text), std::string::npos) << refused.error().message;
  }
}

TEST(SimulatorOptions, RefusesUnknownAndOutOfRange) {
  SimulatorOptions options;
  const auto unknown = options.set_option("colour", "red");
  ASSERT_FALSE(unknown);
  for (const auto& help : SimulatorOptions::help()) {
    EXPECT_NE(unknown.error().message.find(help.key), std::string::npos) << help.key;
  }
  EXPECT_FALSE(options.set_option("blur", "1.5"));
  EXPECT_FALSE(options.set_option("noise", "nan"));
  EXPECT_FALSE(options.set_option("frames", "0"));
  EXPECT_FALSE(options.set_option("speed", ""));
}

TEST(Scenario, UnknownNameListsTheKnown) {
  const auto made = make_scenario("moon", {});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ErrorCode::kUsage);
  for (const ScenarioInfo& info : scenario_list()) {
    EXPECT_NE(made.error().message.find(info.name), std::string::npos);
    EXPECT_TRUE(make_scenario(info.name, {.seed = 3})) << info.name;
  }
}

TEST(Simulator, SameSeedSameBytesInAnyOrder) {
  SimulatorOptions options;
  options.frames = 40;
  auto first = Simulator::make("desk", options).value();
  auto second = Simulator::make("desk", options).value();
  const SimFrame early = first.frame(3);
  const SimFrame late = first.frame(39);
  const SimFrame late_again = second.frame(39);
  const SimFrame early_again = second.frame(3);
  EXPECT_TRUE(same(early.image, early_again.image));
  EXPECT_TRUE(same(late.image, late_again.image));
  EXPECT_EQ(late.map_from_camera.translation(), late_again.map_from_camera.translation());
  EXPECT_EQ(late.time.nanoseconds, 1300000000);
}

TEST(Simulator, AnotherSeedIsAnotherWorld) {
  SimulatorOptions options = plain_options();
  auto one = Simulator::make("desk", options).value();
  options.seed = 2;
  auto two = Simulator::make("desk", options).value();
  EXPECT_FALSE(same(one.frame(0).image, two.frame(0).image));
  EXPECT_GT(
      (one.frame(300).map_from_camera.translation() - two.frame(300).map_from_camera.translation()).norm(),
      1e-3);
}

TEST(Simulator, HandMovesLikeAHand) {
  // Bounds about the truth of real hand-held recordings (TUM fr1_xyz: 0.33 m/s, 19 deg/s, 16 m/s^3 RMS).
  for (const uint64_t seed : {1, 2, 3}) {
    SimulatorOptions options;
    options.seed = seed;
    const auto simulator = Simulator::make("desk", options).value();
    const double dt = 1 / kSimulatorFrameRate;
    double speed2 = 0;
    double rate2 = 0;
    double jerk2 = 0;
    double fastest = 0;
    double jerkiest = 0;
    const int count = simulator.frame_count();
    for (int i = 0; i < count; ++i) {
      const auto pose = [&](int k) { return simulator.map_from_camera((i + k) * dt); };
      const Eigen::Vector3d velocity = (pose(1).translation() - pose(0).translation()) / dt;
      const double rate = so3_log(pose(0).rotation().conjugate() * pose(1).rotation()).norm() / dt;
      const double jerk = (pose(3).translation() - 3 * pose(2).translation() + 3 * pose(1).translation() -
                           pose(0).translation())
                              .norm() /
                          (dt * dt * dt);
      speed2 += velocity.squaredNorm() / count;
      rate2 += rate * rate / count;
      jerk2 += jerk * jerk / count;
      fastest = std::max(fastest, velocity.norm());
      jerkiest = std::max(jerkiest, jerk);
    }
    const double degrees = 180 / std::numbers::pi;
    EXPECT_GT(std::sqrt(speed2), 0.2) << "seed " << seed;
    EXPECT_LT(std::sqrt(speed2), 0.4) << "seed " << seed;
    EXPECT_GT(std::sqrt(rate2) * degrees, 12) << "seed " << seed;
    EXPECT_LT(std::sqrt(rate2) * degrees, 25) << "seed " << seed;
    EXPECT_GT(std::sqrt(jerk2), 8) << "seed " << seed;
    EXPECT_LT(std::sqrt(jerk2), 60) << "seed " << seed;
    EXPECT_LT(fastest, 1.0) << "seed " << seed;
    EXPECT_LT(jerkiest, 150) << "seed " << seed;
  }
}

TEST(Simulator, TruthIsContinuous) {
  const auto simulator = Simulator::make("desk", {}).value();
  // Over knots of the spline and the end of the loop: halving the step quarters the second difference.
  for (double t = 0; t < 130; t += 0.4) {
    const auto second = [&](double h) -> Eigen::Vector3d {
      return simulator.map_from_camera(t + h).translation() - 2 * simulator.map_from_camera(t).translation() +
             simulator.map_from_camera(t - h).translation();
    };
    EXPECT_LT((second(1e-3) / 1e-6 - second(5e-4) / 2.5e-7).norm(), 0.5) << "at " << t;
  }
}

TEST(Simulator, StartsWithASidewaysMove) {
  const auto simulator = Simulator::make("desk", {}).value();
  const SE3 start = simulator.map_from_camera(0.3);
  double widest = 0;
  for (double t = 0.3; t < 3; t += 0.1) {
    const Eigen::Vector3d moved = start.inverse() * simulator.map_from_camera(t).translation();
    widest = std::max(widest, std::abs(moved.x()));
  }
  EXPECT_GT(widest, 0.05);  // enough parallax at 0.7 m
  EXPECT_LT(widest, 0.25);
}

TEST(Simulator, SpeedScalesTheHand) {
  const auto rms_speed = [](double factor) {
    SimulatorOptions options;
    options.speed = factor;
    const auto simulator = Simulator::make("desk", options).value();
    double sum = 0;
    for (int i = 0; i < 600; ++i) {
      const double t = 0.1 * i / factor;
      sum += (simulator.map_from_camera(t + 1e-3).translation() - simulator.map_from_camera(t).translation())
                 .squaredNorm();
    }
    return std::sqrt(sum / 600) / 1e-3;
  };
  EXPECT_NEAR(rms_speed(2) / rms_speed(1), 2, 0.05);
}

TEST(Simulator, ViewsHaveCornersAndBlanksLikeRealOnes) {
  // 7-Scenes' redkitchen by the same count: 2000 to 10000 corners, 0.3 to 0.6 of the blocks empty.
  for (const uint64_t seed : {1, 2}) {
    SimulatorOptions options;
    options.seed = seed;
    auto simulator = Simulator::make("desk", options).value();
    double empty_share = 0;
    int views = 0;
    for (int i = 0; i < simulator.frame_count(); i += 150, ++views) {
      const CornerStatistics corners = find_corners(simulator.frame(i).image);
      EXPECT_GT(corners.count, 1500) << "seed " << seed << " frame " << i;
      EXPECT_LT(corners.count, 14000) << "seed " << seed << " frame " << i;
      empty_share += corners.empty_share;
    }
    EXPECT_GT(empty_share / views, 0.2) << "seed " << seed;
    EXPECT_LT(empty_share / views, 0.5) << "seed " << seed;
  }
}

TEST(Simulator, BlurAndExposureShow) {
  SimulatorOptions options = plain_options();
  auto still = Simulator::make("desk", options).value();
  options.blur = 0.9;
  auto blurred = Simulator::make("desk", options).value();
  options = plain_options();
  options.exposure = 0.5;
  auto hunting = Simulator::make("desk", options).value();
  double darkest = 10;
  double brightest = 0;
  double sharp = 0;
  double soft = 0;
  for (int i = 300; i < 900; i += 60) {
    sharp += sharpness(still.frame(i).image);
    soft += sharpness(blurred.frame(i).image);
    const double ratio = mean_of(hunting.frame(i).image) / mean_of(still.frame(i).image);
    darkest = std::min(darkest, ratio);
    brightest = std::max(brightest, ratio);
  }
  EXPECT_LT(soft, 0.8 * sharp);
  EXPECT_LT(darkest, 0.85);
  EXPECT_GT(brightest, 1.1);
}

}  // namespace
}  // namespace cairn
