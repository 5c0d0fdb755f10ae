// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/solver.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "client/app/calibrate/board_pose.h"
#include "client/app/calibrate/test_boards.h"

namespace cairn {
namespace {

using testing::make_or_fail;

constexpr unsigned kSeed = 11;
constexpr ImageSize kSize{640, 480};
const CameraParameters kRadtan{
    CameraModel::kPinholeRadtan, 640, 480, {520, 523, 314, 246, -0.21, 0.06, 8e-4, -5e-4}};
const CameraParameters kKb4{
    CameraModel::kKannalaBrandt, 640, 480, {240, 241, 322, 237, 0.03, -0.012, 0.006, -0.001}};

/// Points of a 9x6 grid seen with noise; those outside the image are left out.
std::vector<BoardView> make_views(const Camera& camera, size_t count, double sigma, double max_tilt,
                                  std::mt19937* random) {
  std::normal_distribution<double> noise(0, sigma);
  std::vector<BoardView> views;
  while (views.size() < count) {
    const SE3 pose = testing::random_pose(camera, 8, 5, max_tilt, random);
    BoardView view;
    for (int i = 0; i < 9 * 6; ++i) {
      const Eigen::Vector3d point = Eigen::Vector3i(i % 9, i / 9, 0).cast<double>();
      const auto pixel = camera.project(pose * point);
      if (!pixel || !camera.in_image(*pixel)) continue;
      view.on_board.push_back(point);
      view.pixels.emplace_back(pixel->x() + noise(*random), pixel->y() + noise(*random));
    }
    if (view.size() >= 20) views.push_back(std::move(view));
  }
  return views;
}

class Solver : public ::testing::TestWithParam<CameraParameters> {};
INSTANTIATE_TEST_SUITE_P(Models, Solver, ::testing::Values(kRadtan, kKb4),
                         [](const auto& tested) { return tested.index == 0 ? "radtan" : "kb4"; });

TEST_P(Solver, FindsTheCameraOfPerfectViews) {
  const auto camera = make_or_fail(GetParam());
  std::mt19937 random(kSeed);
  const auto solved = calibrate(GetParam().model, kSize, make_views(*camera, 12, 0, 0.7, &random));
  ASSERT_TRUE(solved) << solved.error().message;
  EXPECT_LT(solved->rms, 1e-6);
  for (size_t i = 0; i < 8; ++i) EXPECT_NEAR(solved->parameters.values[i], GetParam().values[i], 1e-4) << i;
}

TEST_P(Solver, SigmaIsTheSpreadOverRepeatedCalibrations) {
  const auto camera = make_or_fail(GetParam());
  constexpr int kTrials = 60;
  constexpr double kNoise = 0.3;
  std::mt19937 random(kSeed);
  std::array<double, 8> sum_squares{};  // of the error in units of sigma
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto solved = calibrate(GetParam().model, kSize, make_views(*camera, 10, kNoise, 0.7, &random));
    ASSERT_TRUE(solved) << solved.error().message << ", seed " << kSeed << ", trial " << trial;
    EXPECT_NEAR(solved->rms, kNoise * std::sqrt(2.0), 0.05);
    for (size_t i = 0; i < 8; ++i) {
      sum_squares[i] += std::pow((solved->parameters.values[i] - GetParam().values[i]) / solved->sigma[i], 2);
    }
  }
  // The mean of 60 squares of a normal deviate has a sigma of 0.18.
  for (size_t i = 0; i < 8; ++i)
    EXPECT_NEAR(sum_squares[i] / kTrials, 1, 0.6) << "value " << i << ", seed " << kSeed;
}

TEST(RadtanSolver, AgreesWithOpenCv) {
  const auto camera = make_or_fail(kRadtan);
  std::mt19937 random(kSeed);
  const auto views = make_views(*camera, 12, 0.25, 0.6, &random);
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
  for (const auto& view : views) {
    points.emplace_back();
    pixels.emplace_back();
    for (size_t i = 0; i < view.size(); ++i) {
      points.back().emplace_back(view.on_board[i].x(), view.on_board[i].y(), 0);
      pixels.back().emplace_back(view.pixels[i].x(), view.pixels[i].y());
    }
  }
  cv::Mat matrix;
  cv::Mat distortion;
  cv::Mat sigma;
  const double rms =
      cv::calibrateCamera(points, pixels, {640, 480}, matrix, distortion, cv::noArray(), cv::noArray(), sigma,
                          cv::noArray(), cv::noArray(), cv::CALIB_FIX_K3,
                          cv::TermCriteria(cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 200, 1e-12));
  const auto solved = calibrate(kRadtan.model, kSize, views);
  ASSERT_TRUE(solved) << solved.error().message;
  EXPECT_NEAR(solved->rms, rms, 0.01 * rms);
  const std::array<double, 8> theirs = {
      matrix.at<double>(0, 0),  matrix.at<double>(1, 1),  matrix.at<double>(0, 2),  matrix.at<double>(1, 2),
      distortion.at<double>(0), distortion.at<double>(1), distortion.at<double>(2), distortion.at<double>(3)};
  // OpenCV takes the residuals' variance over points less parameters, not over their two coordinates each:
  // its sigmas are larger by this.
  size_t count = 0;
  for (const auto& view : views) count += view.size();
  const double free = 8 + 6.0 * static_cast<double>(views.size());
  const double ratio =
      std::sqrt((2 * static_cast<double>(count) - free) / (static_cast<double>(count) - free));
  for (size_t i = 0; i < 8; ++i) {
    EXPECT_NEAR(solved->parameters.values[i], theirs[i], 0.3 * solved->sigma[i]) << i;
    EXPECT_NEAR(sigma.at<double>(static_cast<int>(i)) / solved->sigma[i], ratio, 0.01 * ratio) << i;
  }
}

TEST_P(Solver, LeavesOutWrongPointsAndAWrongView) {
  const auto camera = make_or_fail(GetParam());
  std::mt19937 random(kSeed);
  auto views = make_views(*camera, 14, 0.2, 0.7, &random);
  std::uniform_real_distribution<double> wild(10, 40);
  for (auto& pixel : views[3].pixels) pixel += Eigen::Vector2d(wild(random), wild(random));
  for (const size_t v : {5, 7, 9}) views[v].pixels[2].x() += 15;
  const auto solved = calibrate(GetParam().model, kSize, views);
  ASSERT_TRUE(solved) << solved.error().message;
  EXPECT_EQ(std::count(solved->views[3].inliers.begin(), solved->views[3].inliers.end(), true), 0);
  for (const size_t v : {5, 7, 9}) EXPECT_FALSE(solved->views[v].inliers[2]);
  EXPECT_LT(solved->rms, 0.35);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(solved->parameters.values[i], GetParam().values[i], 5 * solved->sigma[i]) << i;
  }
}

TEST(SolverErrors, TooFewViewsAndViewsThatSayNothing) {
  const auto camera = make_or_fail(kRadtan);
  std::mt19937 random(kSeed);
  const auto two = calibrate(kRadtan.model, kSize, make_views(*camera, 2, 0, 0.5, &random));
  ASSERT_FALSE(two);
  EXPECT_EQ(two.error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(calibrate(CameraModel::kFov, kSize, {}).error().code, ErrorCode::kUsage);
  // Points on a line determine no pose.
  std::vector<BoardView> lines(5);
  for (auto& line : lines) {
    for (int i = 0; i < 10; ++i) {
      line.on_board.emplace_back(i, 0, 0);
      line.pixels.emplace_back(100 + 30 * i, 200);
    }
  }
  EXPECT_EQ(calibrate(kRadtan.model, kSize, lines).error().code, ErrorCode::kDegenerate);
}

TEST(SolverErrors, ABoardAlwaysParallelToTheImageLeavesTheFocalLengthOpen) {
  const auto camera = make_or_fail({CameraModel::kPinholeRadtan, 640, 480, {520, 520, 320, 240, 0, 0, 0, 0}});
  std::mt19937 random(kSeed);
  const auto solved = calibrate(kRadtan.model, kSize, make_views(*camera, 10, 0.2, 0, &random));
  if (!solved) return;  // said so: just as well
  EXPECT_GT(solved->sigma[0], 0.02 * solved->parameters.values[0]);
}

TEST(BoardPose, IsExactForPerfectPixels) {
  for (const auto& parameters : {kRadtan, kKb4}) {
    const auto camera = make_or_fail(parameters);
    std::mt19937 random(kSeed);
    for (int trial = 0; trial < 20; ++trial) {
      const SE3 pose = testing::random_pose(*camera, 8, 5, 1.0, &random);
      BoardView view;
      for (int i = 0; i < 12; ++i) {
        const Eigen::Vector3d point = Eigen::Vector3i(i % 4, i / 4, 0).cast<double>();
        if (const auto pixel = camera->project(pose * point)) {
          view.on_board.push_back(point);
          view.pixels.push_back(*pixel);
        }
      }
      const auto found = board_pose(*camera, view);
      ASSERT_TRUE(found) << "seed " << kSeed << ", trial " << trial;
      EXPECT_LT((*found * pose.inverse()).log().norm(), 1e-5) << "seed " << kSeed << ", trial " << trial;
    }
  }
}

}  // namespace
}  // namespace cairn
