// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/free_camera.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "common/bundle/bundle_scene.h"
#include "common/bundle/find_cameras.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

using namespace cairn::testing;  // NOLINT(google-build-using-namespace)

const Intrinsics kLoosePrior = Intrinsics::Constant(10);

/// Makes the camera of all poses a free one.
void free_the_camera(BundleProblem* problem, const CameraPtr& start, const Intrinsics& prior_sigma) {
  problem->free_cameras = {
      {.camera = start, .prior_mean = intrinsics_of(*start), .prior_sigma = prior_sigma}};
  for (BundlePose& p : problem->poses) {
    p.camera = start;
    p.free_camera = 0;
  }
}

CameraPtr simple_camera(double focal, double k1) {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {focal, focal, 320, 240, k1, 0, 0, 0, 0}});
}

/// Keyframes of a hand-held camera that looks at a table from all around its place: moves sideways and turns
/// towards what it sees. Noise of half a pixel.
BundleProblem desk_scene(const CameraPtr& camera, Random* random) {
  constexpr int kPoses = 10;
  constexpr int kPoints = 150;
  BundleProblem problem;
  for (int i = 0; i < kPoses; ++i) {
    Vector6d xi = random->twist(0.03);
    xi[0] -= 0.08 * i;
    xi[4] += 0.06 * i;
    problem.poses.push_back({SE3::exp(xi), camera, i == 0});
  }
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector3d point(random->uniform(-0.5, 0.8), random->uniform(-0.4, 0.4),
                                random->uniform(0.8, 1.6));
    std::vector<BundleObservation> seen;
    for (int k = 0; k < kPoses; ++k) {
      const auto pixel = camera->project(problem.poses[static_cast<size_t>(k)].camera_from_map * point);
      if (!pixel || !camera->in_image(*pixel)) continue;
      const Eigen::Vector2d noise(random->normal(0.5), random->normal(0.5));
      seen.push_back({k, static_cast<int>(problem.points.size()), *pixel + noise, 1.0});
    }
    if (seen.size() < 3) continue;
    problem.points.push_back(point);
    problem.observations.insert(problem.observations.end(), seen.begin(), seen.end());
  }
  return problem;
}

BundleOptions to_the_end() {
  BundleOptions options;
  options.function_tolerance = 1e-12;
  options.max_iterations = 100;
  return options;
}

TEST(FreeCamera, IntrinsicsGoInAndOut) {
  const CameraPtr camera = distorted_camera();
  const Intrinsics wanted(std::log(612.0), 0.07);
  const CameraPtr changed = with_intrinsics(*camera, wanted);
  ASSERT_NE(changed, nullptr);
  EXPECT_LT((intrinsics_of(*changed) - wanted).norm(), 1e-12);
  const auto& before = camera->parameters().values;
  const auto& after = changed->parameters().values;
  EXPECT_NEAR(after[1] / after[0], before[1] / before[0], 1e-12);
  for (const size_t kept : {2, 3, 5, 6, 7}) EXPECT_EQ(after[kept], before[kept]) << kept;
  EXPECT_EQ(with_intrinsics(*camera, {std::nan(""), 0}), nullptr);
}

TEST(FreeCamera, DerivativeIsTheNumericOne) {
  const CameraPtr camera = distorted_camera();
  Random random(1);
  constexpr double kStep = 1e-6;
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Vector3d point(random.uniform(-0.5, 0.5), random.uniform(-0.4, 0.4), random.uniform(0.8, 3));
    const auto analytic = d_pixel_d_intrinsics(*camera, point);
    for (int i = 0; i < kIntrinsics; ++i) {
      const Intrinsics step = kStep * Intrinsics::Unit(i);
      const auto plus = with_intrinsics(*camera, intrinsics_of(*camera) + step)->project(point);
      const auto minus = with_intrinsics(*camera, intrinsics_of(*camera) - step)->project(point);
      ASSERT_TRUE(plus && minus);
      const Eigen::Vector2d numeric = (*plus - *minus) / (2 * kStep);
      EXPECT_LT((numeric - analytic.col(i)).norm(), 1e-4 * (1 + numeric.norm())) << i;
    }
  }
}

TEST(FreeCamera, ThePullOfAPriorIsTheSlopeOfItsCost) {
  FreeCamera prior{.camera = simple_camera(500, 0)};
  prior.prior_mean = intrinsics_of(*prior.camera);
  prior.prior_sigma = {0.2, 0.1};
  constexpr double kStep = 1e-5;
  constexpr double kCutoff = 4;
  for (const double sigmas : {-3.5, -2.0, 0.0, 1.0, 2.9, 4.0}) {  // on both sides of where it ends
    const Intrinsics at = prior.prior_mean + sigmas * prior.prior_sigma;
    const PriorPull pull = prior_pull(prior, *with_intrinsics(*prior.camera, at), kCutoff);
    for (int i = 0; i < kIntrinsics; ++i) {
      const Intrinsics step = kStep * Intrinsics::Unit(i);
      const auto cost = [&](const Intrinsics& values) {
        return prior_cost(prior, *with_intrinsics(*prior.camera, values), kCutoff);
      };
      const double slope = (cost(at + step) - cost(at - step)) / (2 * kStep);
      EXPECT_NEAR(pull.gradient[i], slope, 1e-5 * (1 + std::abs(slope))) << sigmas;
      const double curvature = (cost(at + step) - 2 * cost(at) + cost(at - step)) / (kStep * kStep);
      EXPECT_NEAR(pull.curvature[i], curvature, 1e-2 * (1 + std::abs(curvature))) << sigmas;
    }
  }
}

TEST(FindCameras, TheFocalLengthIsFoundFromAFarStart) {
  for (const double start : {300.0, 450.0, 900.0}) {
    SCOPED_TRACE(start);
    Random random(7);
    BundleProblem problem = desk_scene(simple_camera(525, -0.03), &random);
    const CameraPtr wrong = simple_camera(start, 0);
    free_the_camera(&problem, wrong, {0.5, 0.1});
    problem.free_cameras[0].covariance = problem.free_cameras[0].prior_sigma.cwiseAbs2().asDiagonal();
    // The scene as it was made with the camera believed in.
    for (Eigen::Vector3d& p : problem.points) p.z() *= start / 525;
    for (BundlePose& p : problem.poses) {
      if (p.fixed) continue;
      const Eigen::Vector3d turn = so3_log(p.camera_from_map.rotation()) * 525 / start;
      p.camera_from_map = SE3(so3_exp(turn), p.camera_from_map.translation());
    }
    BundleOptions options = to_the_end();
    ASSERT_TRUE(find_cameras(&problem, options).usable);
    const FreeCamera& found = problem.free_cameras[0];
    const double sigma = std::sqrt(found.covariance(0, 0));  // of the logarithm
    EXPECT_LT(sigma, 0.03);
    EXPECT_LT(std::abs(std::log(found.camera->focal_length() / 525)), 3 * sigma);
  }
}

TEST(FindCameras, SigmaOwnsUpToWhatIsTakenForGiven) {
  Random random(3);
  // The principal point is 6 px from where it is believed to be, and there is a k2.
  const CameraPtr truth =
      *make_camera({CameraModel::kPinholeRadtan, 640, 480, {525, 525, 326, 236, -0.1, 0.04, 0, 0, 0}});
  BundleProblem problem = desk_scene(truth, &random);
  free_the_camera(&problem, simple_camera(525, -0.1), {0.35, 0.1});
  problem.free_cameras[0].covariance = problem.free_cameras[0].prior_sigma.cwiseAbs2().asDiagonal();
  BundleProblem formal = problem;
  ASSERT_TRUE(solve_bundle(&formal, to_the_end()).usable);
  ASSERT_TRUE(find_cameras(&problem, to_the_end()).usable);
  const double error = std::abs(std::log(problem.free_cameras[0].camera->focal_length() / 525));
  const double sigma = std::sqrt(problem.free_cameras[0].covariance(0, 0));
  EXPECT_LT(error, 3 * sigma);
  EXPECT_GT(sigma, 1.3 * std::sqrt(formal.free_cameras[0].covariance(0, 0)))
      << "half a pixel of noise is the rest";
  EXPECT_LT(sigma, 0.2) << "so large a sigma says nothing";
}

/// Adds what no two keyframes have in common: each image is a little larger or smaller than it should be.
void breathe(BundleProblem* problem, double sigma, Random* random) {
  std::vector<double> size(problem->poses.size());
  for (double& s : size) s = random->normal(sigma);
  const Eigen::Vector2d middle(320, 240);
  for (BundleObservation& o : problem->observations)
    o.pixel += size[static_cast<size_t>(o.pose)] * (o.pixel - middle);
}

TEST(FindCameras, SigmaIsTheSpreadOfRepeatedRunsThoughErrorsAreNotIndependent) {
  constexpr int kRuns = 40;
  double errors = 0;
  double promised = 0;
  double formally_promised = 0;
  Random random(5);
  for (int run = 0; run < kRuns; ++run) {
    BundleProblem problem = desk_scene(simple_camera(525, -0.03), &random);
    breathe(&problem, 0.01, &random);
    free_the_camera(&problem, simple_camera(525, -0.03), {0.35, 0.1});
    problem.free_cameras[0].covariance = Eigen::Vector2d(0.02, 0.02).cwiseAbs2().asDiagonal();
    BundleProblem formal = problem;
    ASSERT_TRUE(solve_bundle(&formal, to_the_end()).usable);
    ASSERT_TRUE(find_cameras(&problem, to_the_end()).usable);
    const double error = std::log(problem.free_cameras[0].camera->focal_length() / 525);
    errors += error * error / kRuns;
    promised += problem.free_cameras[0].covariance(0, 0) / kRuns;
    formally_promised += formal.free_cameras[0].covariance(0, 0) / kRuns;
  }
  EXPECT_LT(std::sqrt(promised / errors), 2);
  EXPECT_GT(std::sqrt(promised / errors), 0.5);
  EXPECT_LT(std::sqrt(formally_promised / errors), 0.3) << "errors that are independent test nothing";
}

TEST(FindCameras, TheSpreadIsThatOfACamerasOwnPartOfTheMotion) {
  const auto sigma_of_the_last_poses = [](bool breathes) {
    Random random(11);
    BundleProblem problem = desk_scene(simple_camera(525, -0.03), &random);
    if (breathes) breathe(&problem, 0.01, &random);
    free_the_camera(&problem, simple_camera(525, -0.03), {0.35, 0.1});
    problem.free_cameras[0].covariance = Eigen::Vector2d(0.02, 0.02).cwiseAbs2().asDiagonal();
    for (size_t i = 0; i < 4; ++i) problem.poses[i].free_camera = -1;  // another, known one made the map
    EXPECT_TRUE(find_cameras(&problem, to_the_end()).usable);
    return std::sqrt(problem.free_cameras[0].covariance(0, 0));
  };
  EXPECT_GT(sigma_of_the_last_poses(true), 1.3 * sigma_of_the_last_poses(false));
}

TEST(FindCameras, OneThatIsNotJudgedMovesAlongAndStaysAsUncertainAsItWas) {
  Random random(7);
  BundleProblem problem = desk_scene(simple_camera(525, 0), &random);
  free_the_camera(&problem, simple_camera(515, 0), {0.35, 0.1});
  const Eigen::Matrix2d before = Eigen::Vector2d(0.04, 0.01).cwiseAbs2().asDiagonal();
  problem.free_cameras[0].covariance = before;
  problem.free_cameras[0].judge = false;
  ASSERT_TRUE(find_cameras(&problem, to_the_end()).usable);
  EXPECT_NEAR(problem.free_cameras[0].camera->focal_length(), 525, 8);
  EXPECT_EQ(problem.free_cameras[0].covariance, before);
}

TEST(FreeCamera, LargestMoveIsThatOfTheCorner) {
  const CameraPtr camera = simple_camera(500, 0);
  EXPECT_LT(largest_move(*camera, *camera), 1e-9);
  // Every pixel goes away from the centre by a hundredth of its distance: 400 px at (0, 0).
  EXPECT_NEAR(largest_move(*camera, *simple_camera(505, 0)), 4, 1e-9);
}

TEST(FreeCamera, ExactScenesGiveTheCameraBack) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const BundleProblem truth = exact_scene(&random);
    const CameraPtr camera = truth.poses.front().camera;
    BundleProblem problem = truth;
    perturb(&problem, &random);
    free_the_camera(&problem, with_intrinsics(*camera, intrinsics_of(*camera) + Intrinsics(0.1, 0.05)),
                    kLoosePrior);
    BundleOptions options = to_the_end();
    options.rounds = 3;
    ASSERT_TRUE(solve_bundle(&problem, options).usable);
    EXPECT_LT(largest_difference(problem, truth), 1e-4);
    EXPECT_LT((intrinsics_of(*problem.free_cameras[0].camera) - intrinsics_of(*camera)).norm(), 1e-4);
    EXPECT_EQ(problem.poses.back().camera, problem.free_cameras[0].camera);
  }
}

TEST(FreeCamera, TwoCamerasOfOneMapAreToldApart) {
  Random random(7);
  const BundleProblem truth = exact_scene(&random);
  const CameraPtr one = truth.poses.front().camera;
  const CameraPtr other = simple_camera(600, 0.1);
  BundleProblem problem = truth;
  for (BundleObservation& o : problem.observations) {
    if (o.pose % 2 == 0) continue;
    const auto& pose = problem.poses[static_cast<size_t>(o.pose)].camera_from_map;
    o.pixel = *other->project(pose * problem.points[static_cast<size_t>(o.point)]);
  }
  perturb(&problem, &random);
  free_the_camera(&problem, with_intrinsics(*one, intrinsics_of(*one) + Intrinsics(0.08, 0.03)), kLoosePrior);
  const CameraPtr start = simple_camera(550, 0);
  problem.free_cameras.push_back(
      {.camera = start, .prior_mean = intrinsics_of(*start), .prior_sigma = kLoosePrior});
  for (size_t i = 1; i < problem.poses.size(); i += 2) {
    problem.poses[i].camera = start;
    problem.poses[i].free_camera = 1;
  }
  BundleOptions options = to_the_end();
  options.rounds = 3;
  ASSERT_TRUE(solve_bundle(&problem, options).usable);
  EXPECT_LT((intrinsics_of(*problem.free_cameras[0].camera) - intrinsics_of(*one)).norm(), 1e-4);
  EXPECT_LT((intrinsics_of(*problem.free_cameras[1].camera) - intrinsics_of(*other)).norm(), 1e-4);
}

/// Residuals, whitened, as a function of everything that moves: poses, points, intrinsics.
Eigen::VectorXd residuals_at(BundleProblem problem, const Eigen::VectorXd& step) {
  Eigen::Index next = 0;
  for (BundlePose& p : problem.poses) {
    if (p.fixed) continue;
    p.camera_from_map = SE3::exp(Vector6d(step.segment<6>(next))) * p.camera_from_map;
    next += 6;
  }
  for (Eigen::Vector3d& p : problem.points) {
    p += step.segment<3>(next);
    next += 3;
  }
  const Camera& before = *problem.free_cameras[0].camera;
  const CameraPtr camera = with_intrinsics(before, intrinsics_of(before) + Intrinsics(step.segment<2>(next)));
  Eigen::VectorXd residuals(static_cast<Eigen::Index>(2 * problem.observations.size()));
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    const auto pixel = camera->project(problem.poses[static_cast<size_t>(o.pose)].camera_from_map *
                                       problem.points[static_cast<size_t>(o.point)]);
    residuals.segment<2>(static_cast<Eigen::Index>(2 * i)) = (*pixel - o.pixel) * o.inverse_sigma;
  }
  return residuals;
}

TEST(FreeCamera, CovarianceIsThatOfTheWholeNormalEquations) {
  Random random(9);
  BundleProblem problem = desk_scene(simple_camera(525, -0.1), &random);
  problem.poses[1].fixed = true;  // the scale too: the whole system is regular
  free_the_camera(&problem, simple_camera(525, -0.1), {0.02, 0.05});
  // Every residual a small part of the cut-off: the robust weights are 1 for both.
  BundleOptions options = to_the_end();
  options.min_squared_cutoff = 1e6;
  const BundleReport report = solve_bundle(&problem, options);
  ASSERT_TRUE(report.usable);

  const auto unknowns =
      static_cast<Eigen::Index>(6 * (problem.poses.size() - 2) + 3 * problem.points.size() + 2);
  const Eigen::VectorXd at_solution = residuals_at(problem, Eigen::VectorXd::Zero(unknowns));
  Eigen::MatrixXd jacobian(at_solution.size(), unknowns);
  constexpr double kStep = 1e-6;
  for (Eigen::Index i = 0; i < unknowns; ++i) {
    const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(unknowns, i);
    jacobian.col(i) = (residuals_at(problem, step) - residuals_at(problem, -step)) / (2 * kStep);
  }
  Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  information.diagonal().tail<2>() +=
      noise_variance(report.squared_cutoff) * problem.free_cameras[0].prior_sigma.cwiseAbs2().cwiseInverse();
  const double variance = at_solution.squaredNorm() / static_cast<double>(at_solution.size() - unknowns);
  const Eigen::Matrix2d expected = variance * information.inverse().bottomRightCorner<2, 2>();
  EXPECT_LT((problem.free_cameras[0].covariance - expected).norm(), 0.01 * expected.norm())
      << problem.free_cameras[0].covariance << "\n\n"
      << expected;
}

TEST(FreeCamera, SigmaIsTheSpreadOverRepeatedScenes) {
  constexpr int kTrials = 60;
  const CameraPtr truth = simple_camera(525, -0.1);
  Intrinsics squares = Intrinsics::Zero();
  Intrinsics stated = Intrinsics::Zero();
  for (uint64_t seed = 1; seed <= kTrials; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    BundleProblem problem = desk_scene(truth, &random);
    perturb(&problem, &random);
    free_the_camera(&problem, simple_camera(560, 0), kLoosePrior);
    BundleOptions options = to_the_end();
    options.rounds = 3;
    ASSERT_TRUE(solve_bundle(&problem, options).usable);
    const FreeCamera& found = problem.free_cameras[0];
    const Intrinsics error = intrinsics_of(*found.camera) - intrinsics_of(*truth);
    const Intrinsics variance = found.covariance.diagonal();
    squares += error.cwiseAbs2();
    stated += variance;
    EXPECT_LT(error.cwiseAbs2().cwiseQuotient(variance).maxCoeff(), 16) << "4 sigma";
  }
  // The sum of squares of 60 normal errors has a standard deviation of 18 %.
  const Intrinsics ratio = squares.cwiseQuotient(stated);
  for (int i = 0; i < kIntrinsics; ++i) {
    EXPECT_GT(ratio[i], 0.55) << i;
    EXPECT_LT(ratio[i], 1.6) << i;
  }
}

/// A plane seen head-on, the camera not turned: focal length and distance are one.
TEST(FreeCamera, WhatTheViewsDoNotTellStaysAsUncertainAsThePrior) {
  Random random(11);
  const CameraPtr truth = simple_camera(525, 0);
  BundleProblem problem;
  for (int k = 0; k < 6; ++k) {
    const Eigen::Vector3d center(0.1 * k, 0.05 * (k % 3), 0);
    problem.poses.push_back({SE3(Eigen::Quaterniond::Identity(), -center), truth, k == 0});
  }
  for (int i = 0; i < 150; ++i) {
    problem.points.emplace_back(random.uniform(-0.4, 0.8), random.uniform(-0.4, 0.5), 1.0);
    for (int k = 0; k < 6; ++k) {
      const auto pixel =
          truth->project(problem.poses[static_cast<size_t>(k)].camera_from_map * problem.points.back());
      const Eigen::Vector2d noise(random.normal(0.5), random.normal(0.5));
      problem.observations.push_back({k, i, *pixel + noise, 1.0});
    }
  }
  const Intrinsics prior_sigma(0.3, 0.05);
  free_the_camera(&problem, simple_camera(525, 0), prior_sigma);
  BundleOptions options = to_the_end();
  options.rounds = 3;
  ASSERT_TRUE(solve_bundle(&problem, options).usable);
  EXPECT_GT(std::sqrt(problem.free_cameras[0].covariance(0, 0)), 0.1 * prior_sigma[0]);
}

}  // namespace
}  // namespace cairn
