// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <random>

#include "common/bundle/bundle.h"

/// Bundle problems with known truth, for the tests of the solver.
namespace cairn::testing {

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  double normal(double sigma) { return std::normal_distribution<double>(0, sigma)(engine_); }
  Vector6d twist(double sigma) {
    Vector6d xi;
    for (int i = 0; i < 6; ++i) xi[i] = normal(sigma);
    return xi;
  }

 private:
  std::mt19937_64 engine_;
};

[[nodiscard]] CameraPtr distorted_camera();

/// Cameras along a line in front of a box of points; every point seen by every camera, exactly. Two poses
/// fixed, so that the solution is unique.
[[nodiscard]] BundleProblem exact_scene(Random* random);

/// A camera walking along a wall: points are seen by some of the cameras near them, with noise of 0.5 sigma
/// and one wrong observation in twenty. Only the first pose is fixed.
[[nodiscard]] BundleProblem noisy_walk(int poses, int points, Random* random);

/// Moves the poses that are not fixed and all points at random, by a few pixels in the images, as before an
/// adjustment in a map.
void perturb(BundleProblem* problem, Random* random);

/// Largest distance between poses (twist) and between points of two problems.
[[nodiscard]] double largest_difference(const BundleProblem& a, const BundleProblem& b);

}  // namespace cairn::testing
