// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/metrics.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <random>

namespace cairn {
namespace {

using ::testing::HasSubstr;

MapId map_id(uint8_t n) {
  MapId id;
  id.bytes.fill(n);
  return id;
}

/// A smooth path of some metres at 30 Hz that turns about all axes.
std::vector<StampedPose> wavy_path(int count) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < count; ++i) {
    const double t = i / 30.0;
    const Eigen::Vector3d position(std::sin(0.7 * t), 0.8 * std::cos(0.5 * t), 0.3 * std::sin(1.1 * t));
    const auto rotation = so3_exp(Eigen::Vector3d(0.4 * std::sin(t), 0.3 * t, 0.2 * std::cos(0.3 * t)));
    poses.push_back({Timestamp{1'000'000'000'000 + i * int64_t{33'333'333}}, SE3(rotation, position)});
  }
  return poses;
}

/// The same cameras seen from another frame: position by the similarity, rotation composed.
std::vector<StampedPose> moved(std::vector<StampedPose> poses, const Similarity3& motion) {
  for (auto& pose : poses) {
    const Eigen::Vector3d position = motion * pose.map_from_camera.translation();
    pose.map_from_camera = SE3(motion.rotation() * pose.map_from_camera.rotation(), position);
  }
  return poses;
}

Similarity3 some_similarity(double scale, double angle = 1.1) {
  return {scale, so3_exp(Eigen::Vector3d(0.3, angle, -0.7)), Eigen::Vector3d(4, -2, 7)};
}

Trajectory trajectory(std::vector<StampedPose> poses, MapId map = {}) {
  Trajectory result;
  result.segments.push_back({map, "", std::move(poses)});
  return result;
}

TEST(Ate, AKnownSimilarityIsRecoveredAndLeavesNothing) {
  const auto truth = wavy_path(400);
  const auto estimate = moved(truth, some_similarity(0.37).inverse());
  const auto comparison = compare(trajectory(truth), trajectory(estimate), 0.02, Alignment::kSim3);
  ASSERT_TRUE(comparison) << comparison.error().message;
  EXPECT_EQ(comparison->matched, 400u);
  EXPECT_NEAR(comparison->maps[0].truth_from_map.scale(), 0.37, 1e-9);
  const auto error = absolute_error(*comparison);
  EXPECT_EQ(error.translation.count, 400u);
  EXPECT_LT(error.translation.max, 1e-9);
  double length = 0;
  for (size_t i = 1; i < truth.size(); ++i) {
    length += (truth[i].map_from_camera.translation() - truth[i - 1].map_from_camera.translation()).norm();
  }
  EXPECT_NEAR(comparison->path_length, length, 1e-9);
}

TEST(Ate, RigidAlignmentKeepsTheErrorOfScale) {
  const auto truth = wavy_path(400);
  const auto same_scale = moved(truth, some_similarity(1.0).inverse());
  const auto other_scale = moved(truth, some_similarity(2.0).inverse());
  const auto good = compare(trajectory(truth), trajectory(same_scale), 0.02, Alignment::kSe3);
  ASSERT_TRUE(good);
  EXPECT_LT(absolute_error(*good).translation.max, 1e-9);
  const auto bad = compare(trajectory(truth), trajectory(other_scale), 0.02, Alignment::kSe3);
  ASSERT_TRUE(bad);
  EXPECT_EQ(bad->maps[0].truth_from_map.scale(), 1.0);
  EXPECT_GT(absolute_error(*bad).translation.rmse, 0.1);
}

TEST(Ate, NoiseOfSigmaGivesAnRmseOfSigmaRootThree) {
  const auto truth = wavy_path(3000);
  for (const double sigma : {0.001, 0.01, 0.05}) {
    auto noisy = truth;
    std::mt19937 random(17);
    std::normal_distribution<double> normal(0, sigma);
    for (auto& pose : noisy) {
      const Eigen::Vector3d noise{normal(random), normal(random), normal(random)};
      pose.map_from_camera = SE3(pose.map_from_camera.rotation(), pose.map_from_camera.translation() + noise);
    }
    const auto comparison = compare(trajectory(truth), trajectory(noisy), 0.02, Alignment::kSim3);
    ASSERT_TRUE(comparison);
    EXPECT_NEAR(absolute_error(*comparison).translation.rmse / (sigma * std::sqrt(3.0)), 1.0, 0.03) << sigma;
  }
}

TEST(Ate, EachMapIsAlignedByItself) {
  const auto truth = wavy_path(300);
  const std::vector<Similarity3> frames = {some_similarity(0.5), some_similarity(3.0, -0.4)};
  Trajectory estimate;
  for (size_t piece = 0; piece < 6; ++piece) {
    const size_t map = piece % 2;
    auto poses = moved(truth, frames[map].inverse());
    estimate.segments.push_back({map_id(static_cast<uint8_t>(map + 1)),
                                 "desk",
                                 {poses.begin() + static_cast<ptrdiff_t>(50 * piece),
                                  poses.begin() + static_cast<ptrdiff_t>(50 * piece + 50)}});
  }
  const auto comparison = compare(trajectory(truth), estimate, 0.02, Alignment::kSim3);
  ASSERT_TRUE(comparison) << comparison.error().message;
  ASSERT_EQ(comparison->maps.size(), 2u);
  EXPECT_EQ(comparison->matched, 300u);
  for (size_t map = 0; map < 2; ++map) {
    EXPECT_EQ(comparison->maps[map].pairs.size(), 150u);
    EXPECT_NEAR(comparison->maps[map].truth_from_map.scale(), frames[map].scale(), 1e-9);
  }
  EXPECT_LT(absolute_error(*comparison).translation.max, 1e-9);
}

TEST(Ate, AMapTooSmallToAlignIsLeftOutAndCounted) {
  const auto truth = wavy_path(100);
  Trajectory estimate;
  estimate.segments.push_back({map_id(1), "", {truth.begin(), truth.begin() + 98}});
  estimate.segments.push_back({map_id(2), "", {truth.begin() + 98, truth.end()}});
  const auto comparison = compare(trajectory(truth), estimate, 0.02, Alignment::kSim3);
  ASSERT_TRUE(comparison);
  EXPECT_EQ(comparison->matched, 98u);
  EXPECT_EQ(comparison->unaligned, 2u);
  EXPECT_EQ(absolute_error(*comparison).translation.count, 98u);
}

TEST(Ate, NothingToCompareIsSaid) {
  const auto truth = wavy_path(50);
  auto later = truth;
  for (auto& pose : later) pose.time.nanoseconds += 3'600'000'000'000;
  const auto disjoint = compare(trajectory(truth), trajectory(later), 0.02, Alignment::kSim3);
  ASSERT_FALSE(disjoint);
  EXPECT_EQ(disjoint.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(disjoint.error().message, HasSubstr("1000.000000000"));
  EXPECT_THAT(disjoint.error().message, HasSubstr("4600.000000000"));
  auto still = truth;
  for (auto& pose : still) pose.map_from_camera = SE3();
  const auto degenerate = compare(trajectory(truth), trajectory(still), 0.02, Alignment::kSim3);
  ASSERT_FALSE(degenerate);
  EXPECT_THAT(degenerate.error().message, HasSubstr("50 poses match"));
}

TEST(Association, TakesTheNearestWithinTheLimit) {
  const auto at = [](double seconds) { return StampedPose{Timestamp::from_seconds(seconds), {}}; };
  const std::vector<StampedPose> truth = {at(0), at(1), at(2), at(3)};
  const std::vector<StampedPose> estimate = {at(-5),    at(0.015), at(0.03), at(0.98),
                                             at(1.001), at(2.021), at(2.98)};
  using Pair = std::pair<size_t, size_t>;
  EXPECT_THAT(associate(truth, estimate, 0.02), ::testing::ElementsAre(Pair(0, 1), Pair(1, 4), Pair(3, 6)));
  EXPECT_THAT(associate(estimate, truth, 0.02), ::testing::ElementsAre(Pair(1, 0), Pair(4, 1), Pair(6, 3)));
  EXPECT_THAT(associate(truth, estimate, 0.0), ::testing::IsEmpty());
  EXPECT_THAT(associate(truth, {}, 1.0), ::testing::IsEmpty());
}

TEST(Association, ADenserListAndAShiftWithinTheLimitChangeNothing) {
  const auto dense = wavy_path(300);
  std::vector<StampedPose> sparse;
  for (size_t i = 0; i < dense.size(); i += 4) {
    sparse.push_back(dense[i]);
    sparse.back().time.nanoseconds += i % 8 == 0 ? 9'000'000 : -9'000'000;
  }
  const auto matches = associate(sparse, dense, 0.02);
  ASSERT_EQ(matches.size(), sparse.size());
  for (const auto& [i, j] : matches) EXPECT_EQ(j, 4 * i);
}

TEST(Rpe, IsZeroUnderAnyConstantSimilarity) {
  const auto truth = wavy_path(400);
  const auto comparison =
      compare(trajectory(truth), trajectory(moved(truth, some_similarity(0.1))), 0.02, Alignment::kSim3);
  ASSERT_TRUE(comparison);
  for (const auto unit : {DeltaUnit::kFrames, DeltaUnit::kSeconds, DeltaUnit::kMetres}) {
    const auto error = relative_error(*comparison, 1, unit);
    ASSERT_TRUE(error) << error.error().message;
    EXPECT_LT(error->translation.max, 1e-8);
    EXPECT_LT(error->rotation.max, 1e-7);
  }
  EXPECT_EQ(relative_error(*comparison, 1, DeltaUnit::kFrames)->translation.count, 399u);
  EXPECT_EQ(relative_error(*comparison, 1, DeltaUnit::kSeconds)->translation.count,
            372u);  // the last two: within 10 %
  EXPECT_FALSE(relative_error(*comparison, 1000, DeltaUnit::kMetres));
}

TEST(Rpe, ADriftIsWhatItIsPerDelta) {
  constexpr double kDriftPerSecond = 0.002;
  constexpr double kTurnPerSecond = 0.5 * std::numbers::pi / 180;
  auto truth = wavy_path(600);
  for (auto& pose : truth)
    pose.map_from_camera = SE3(Eigen::Quaterniond::Identity(), pose.map_from_camera.translation());
  auto drifting = truth;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double t = seconds_between(truth[i].time, truth[0].time);
    drifting[i].map_from_camera =
        SE3(so3_exp(Eigen::Vector3d(0, 0, kTurnPerSecond * t)), truth[i].map_from_camera.translation());
  }
  auto comparison = compare(trajectory(truth), trajectory(drifting), 0.02, Alignment::kSe3);
  ASSERT_TRUE(comparison);
  EXPECT_NEAR(relative_error(*comparison, 1, DeltaUnit::kSeconds)->rotation.median, kTurnPerSecond, 1e-6);
  EXPECT_NEAR(relative_error(*comparison, 30, DeltaUnit::kFrames)->rotation.median, kTurnPerSecond, 1e-6);
  EXPECT_NEAR(relative_error(*comparison, 2, DeltaUnit::kSeconds)->rotation.median, 2 * kTurnPerSecond, 1e-6);

  drifting = truth;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double t = seconds_between(truth[i].time, truth[0].time);
    const Eigen::Vector3d drift(0, 0, kDriftPerSecond * t);
    drifting[i].map_from_camera =
        SE3(Eigen::Quaterniond::Identity(), truth[i].map_from_camera.translation() + drift);
  }
  comparison = compare(trajectory(truth), trajectory(drifting), 0.02, Alignment::kSe3);
  ASSERT_TRUE(comparison);
  // The drift along z is seen as a step of 2 mm each second, however the whole was turned to fit best.
  EXPECT_NEAR(relative_error(*comparison, 1, DeltaUnit::kSeconds)->translation.rmse, kDriftPerSecond, 1e-6);
}

TEST(Statistics, AreThoseOfTheList) {
  const auto s = summarize({4, 1, 3, 2});
  EXPECT_EQ(s.count, 4u);
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(30.0 / 4));
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.stddev, std::sqrt(1.25));
  EXPECT_EQ(s.min, 1);
  EXPECT_EQ(s.max, 4);
  EXPECT_EQ(summarize({5, 1, 2}).median, 2);
  EXPECT_EQ(summarize({}).count, 0u);
}

}  // namespace
}  // namespace cairn
