// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/bundle_scene.h"

#include <algorithm>
#include <cmath>

namespace cairn::testing {

CameraPtr distorted_camera() {
  CameraParameters p;
  p.width = 640;
  p.height = 480;
  p.values = {500, 505, 320, 240, -0.15, 0.05, 0.001, -0.002};
  return *make_camera(p);
}

BundleProblem exact_scene(Random* random) {
  BundleProblem problem;
  const CameraPtr camera = distorted_camera();
  for (int i = 0; i < 6; ++i) {
    Vector6d xi = random->twist(0.02);
    xi[0] -= 0.08 * i;
    problem.poses.push_back({SE3::exp(xi), camera, i < 2});
  }
  for (int i = 0; i < 120; ++i) {
    problem.points.emplace_back(random->uniform(-0.2, 0.6), random->uniform(-0.3, 0.3),
                                random->uniform(0.9, 1.6));
    for (int k = 0; k < 6; ++k) {
      const auto pose = static_cast<size_t>(k);
      const auto pixel = camera->project(problem.poses[pose].camera_from_map * problem.points.back());
      if (pixel) problem.observations.push_back({k, i, *pixel, 1.0 / (1 << (i % 3))});
    }
  }
  return problem;
}

BundleProblem noisy_walk(int poses, int points, Random* random) {
  constexpr double kStep = 0.1;
  constexpr double kSight = 0.5;  // along the wall
  constexpr size_t kMinObservers = 4;
  BundleProblem problem;
  const CameraPtr camera = distorted_camera();
  for (int i = 0; i < poses; ++i) {
    Vector6d xi = random->twist(0.02);
    xi[0] -= kStep * i;
    problem.poses.push_back({SE3::exp(xi), camera, i == 0});
  }
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector3d point(random->uniform(0, kStep * (poses - 1)), random->uniform(-0.4, 0.4),
                                random->uniform(0.9, 1.6));
    std::vector<BundleObservation> seen;
    for (int k = 0; k < poses; ++k) {
      if (std::abs(point.x() - kStep * k) > kSight || random->uniform(0, 1) < 0.2) continue;
      const auto pixel = camera->project(problem.poses[static_cast<size_t>(k)].camera_from_map * point);
      if (!pixel) continue;
      const double sigma = 1 << (i % 3);
      Eigen::Vector2d noise(random->normal(0.5 * sigma), random->normal(0.5 * sigma));
      if (random->uniform(0, 1) < 0.05) noise += Eigen::Vector2d(random->uniform(-50, 50), 30 * sigma);
      seen.push_back({k, static_cast<int>(problem.points.size()), *pixel + noise, 1.0 / sigma});
    }
    if (seen.size() < kMinObservers) continue;
    problem.points.push_back(point);
    problem.observations.insert(problem.observations.end(), seen.begin(), seen.end());
  }
  return problem;
}

void perturb(BundleProblem* problem, Random* random) {
  for (BundlePose& p : problem->poses) {
    if (!p.fixed) p.camera_from_map = SE3::exp(random->twist(0.003)) * p.camera_from_map;
  }
  for (Eigen::Vector3d& p : problem->points) {
    p += Eigen::Vector3d(random->normal(0.004), random->normal(0.004), random->normal(0.004));
  }
}

double largest_difference(const BundleProblem& a, const BundleProblem& b) {
  double largest = 0;
  for (size_t i = 0; i < a.poses.size(); ++i) {
    largest =
        std::max(largest, (a.poses[i].camera_from_map * b.poses[i].camera_from_map.inverse()).log().norm());
  }
  for (size_t i = 0; i < a.points.size(); ++i)
    largest = std::max(largest, (a.points[i] - b.points[i]).norm());
  return largest;
}

}  // namespace cairn::testing
