// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/two_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "common/geometry/epipolar.h"

namespace cairn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }
  double uniform(double low, double high) { return low + (high - low) * uniform_(engine_); }
  Eigen::Vector3d vector() { return {normal(), normal(), normal()}; }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_{0, 1};
};

/// Depth of the scene along a ray of camera a.
using DepthOf = std::function<double(const Eigen::Vector3d& ray, Random&)>;

/// Desk seen obliquely from above: the plane n^T X = 1 tilted by 35 degrees.
double tilted_plane(const Eigen::Vector3d& ray) {
  const Eigen::Vector3d n(0, std::sin(35 * kDegree), std::cos(35 * kDegree));
  return ray.z() / n.dot(ray);
}
double plane_depth(const Eigen::Vector3d& ray, Random& /*random*/) {
  return tilted_plane(ray);
}
double frontal_plane_depth(const Eigen::Vector3d& /*ray*/, Random& /*random*/) {
  return 1.0;
}
/// A fifth of the view is a box whose top is nearer by a fifth.
double box_on_plane_depth(const Eigen::Vector3d& ray, Random& /*random*/) {
  const double x = ray.x() / ray.z();
  const double y = ray.y() / ray.z();
  return (std::abs(x) < 0.25 && std::abs(y) < 0.2 ? 0.8 : 1.0) * tilted_plane(ray);
}
double general_depth(const Eigen::Vector3d& /*ray*/, Random& random) {
  return random.uniform(0.6, 1.8);
}

struct Setup {
  CameraParameters camera{CameraModel::kPinholeRadtan, 640, 480, {525, 525, 319.5, 239.5}};
  DepthOf depth = general_depth;
  double baseline = 2 * kDegree;  ///< as parallax at depth 1
  double rotation = 3 * kDegree;
  double noise = 0.5;  ///< px in each image
  double outliers = 0.1;
  int matches = 300;
};

struct Pair {
  CameraPtr camera;
  SE3 b_from_a;
  std::vector<PixelMatch> matches;
  std::vector<bool> outlier;
};

/// A sideways motion of a hand: mostly across the optical axis, as the trails of a start are made.
Pair make_pair(const Setup& setup, unsigned seed) {
  Random random(seed);
  Pair pair;
  pair.camera = make_camera(setup.camera).value();
  const Eigen::Vector3d across = random.vector().cwiseProduct(Eigen::Vector3d(1, 1, 0.2)).normalized();
  pair.b_from_a = SE3(so3_exp(setup.rotation * random.vector().normalized()), setup.baseline * across);
  while (pair.matches.size() < static_cast<size_t>(setup.matches)) {
    const Eigen::Vector2d pixel(random.uniform(0, setup.camera.width - 1),
                                random.uniform(0, setup.camera.height - 1));
    const Eigen::Vector3d ray = pair.camera->unproject(pixel);
    const double depth = setup.depth(ray, random);
    const auto in_b = pair.camera->project(pair.b_from_a * Eigen::Vector3d(ray / ray.z() * depth));
    if (!in_b || !pair.camera->in_image(*in_b)) continue;
    const bool outlier = random.uniform(0, 1) < setup.outliers;
    const Eigen::Vector2d measured =
        outlier ? Eigen::Vector2d(pixel + 25 * Eigen::Vector2d(random.uniform(-1, 1), random.uniform(-1, 1)))
                : *in_b;
    const Eigen::Vector2d noise_a = setup.noise * Eigen::Vector2d(random.normal(), random.normal());
    const Eigen::Vector2d noise_b = setup.noise * Eigen::Vector2d(random.normal(), random.normal());
    pair.matches.push_back({pixel + noise_a, measured + noise_b});
    pair.outlier.push_back(outlier);
  }
  return pair;
}

TwoViewOptions options_for(const Setup& setup) {
  TwoViewOptions options;
  options.sigma = std::max(setup.noise, 0.3);
  return options;
}

double rotation_error(const Pair& pair, const TwoViewGeometry& found) {
  return found.b_from_a.rotation().angularDistance(pair.b_from_a.rotation()) / kDegree;
}

double direction_error(const Pair& pair, const TwoViewGeometry& found) {
  const Eigen::Vector3d t = pair.b_from_a.translation().normalized();
  return std::acos(std::clamp(t.dot(found.b_from_a.translation()), -1.0, 1.0)) / kDegree;
}

/// How many of 100 seeds give a pose within the stated errors [degrees]; says what went wrong with the
/// others.
int good_starts(const Setup& setup, double max_rotation_error, double max_direction_error, std::string* log) {
  int good = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    const Pair pair = make_pair(setup, seed);
    const auto found = estimate_two_view(*pair.camera, *pair.camera, pair.matches, options_for(setup));
    if (!found) {
      *log += "seed " + std::to_string(seed) + " refused: " + found.error().message + "\n";
    } else if (rotation_error(pair, *found) > max_rotation_error ||
               direction_error(pair, *found) > max_direction_error) {
      *log += "seed " + std::to_string(seed) + " off: rotation " +
              std::to_string(rotation_error(pair, *found)) + " direction " +
              std::to_string(direction_error(pair, *found)) + "\n";
    } else {
      ++good;
    }
  }
  return good;
}

struct Scenario {
  std::string name;
  Setup setup;
  double max_rotation_error = 0.5;    ///< [degree]
  double max_direction_error = 10.0;  ///< [degree]
};

class Starts : public testing::TestWithParam<Scenario> {};

Setup with(const std::function<void(Setup&)>& change) {
  Setup setup;
  change(setup);
  return setup;
}

const CameraParameters kCube{CameraModel::kPinholeRadtan, 384, 288, {380, 380, 191.5, 143.5}};
const CameraParameters kEuroc{
    CameraModel::kPinholeRadtan,
    752,
    480,
    {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}};

INSTANTIATE_TEST_SUITE_P(
    All, Starts,
    testing::Values(
        Scenario{"GeneralDepth", with([](Setup& s) { s.depth = general_depth; })},
        Scenario{"Plane", with([](Setup& s) { s.depth = plane_depth; })},
        Scenario{"FrontalPlane", with([](Setup& s) { s.depth = frontal_plane_depth; })},
        Scenario{"BoxOnPlane", with([](Setup& s) { s.depth = box_on_plane_depth; })},
        Scenario{"GeneralDepthThirtyPercentOutliers", with([](Setup& s) { s.outliers = 0.3; })},
        Scenario{"PlaneThirtyPercentOutliers",
                 with([](Setup& s) { s.depth = plane_depth, s.outliers = 0.3; })},
        Scenario{"GeneralDepthOnePixelNoise", with([](Setup& s) { s.noise = 1, s.baseline = 4 * kDegree; })},
        Scenario{"PlaneOnePixelNoise",
                 with([](Setup& s) { s.depth = plane_depth, s.noise = 1, s.baseline = 4 * kDegree; })},
        Scenario{"SmallImageGeneral",
                 with([](Setup& s) { s.camera = kCube, s.baseline = 3 * kDegree, s.matches = 200; })},
        Scenario{"SmallImagePlane", with([](Setup& s) {
                   s.camera = kCube, s.depth = plane_depth, s.baseline = 3 * kDegree, s.matches = 200;
                 })},
        Scenario{"DistortedCamera", with([](Setup& s) { s.camera = kEuroc; })},
        Scenario{"DistortedCameraBoxOnPlane",
                 with([](Setup& s) { s.camera = kEuroc, s.depth = box_on_plane_depth; })},
        Scenario{"FewMatches", with([](Setup& s) { s.matches = 60, s.baseline = 5 * kDegree; })},
        Scenario{"WideBaseline", with([](Setup& s) { s.baseline = 15 * kDegree; })}),
    [](const auto& tested) { return tested.param.name; });

TEST_P(Starts, AtLeast95Of100SeedsAreGood) {
  const auto& [name, setup, max_rotation_error, max_direction_error] = GetParam();
  std::string log;
  EXPECT_GE(good_starts(setup, max_rotation_error, max_direction_error, &log), 95) << log;
}

}  // namespace
}  // namespace cairn
