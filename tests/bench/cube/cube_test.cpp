// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "tests/bench/cube/adjust.h"
#include "tests/bench/cube/dots.h"

namespace cairn::cube {
namespace {

constexpr uint32_t kSeed = 7;
constexpr int kViews = 16;
constexpr double kNoise = 0.03;  // px
constexpr double kRadiusOfDots = 0.2;

CubeCamera truth() {
  CubeCamera camera;
  camera.focal = 610;
  camera.aspect = 0.96;
  camera.cx = 191.5;
  camera.cy = 143.5;
  camera.k1 = -0.08;
  return camera;
}

CubeCamera wrong_start() {
  CubeCamera camera = truth();
  camera.focal = 540;
  camera.aspect = 1;
  camera.k1 = 0;
  return camera;
}

Freedom freedom() {
  Freedom f;
  f.aspect = true;
  f.k1 = true;
  return f;
}

/// Views from above tilting to 45 degrees, as in the sequence.
SE3 view(int i) {
  const double part = static_cast<double>(i) / (kViews - 1);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(-0.1 - 0.7 * part, Eigen::Vector3d::UnitX()) *
                                Eigen::AngleAxisd(0.4 * part, Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(0.2 * part, Eigen::Vector3d::UnitZ()));
  return {turn, Eigen::Vector3d(1 - 2 * part, -1 + part, 33 - 6 * part)};
}

Eigen::Vector2d to_pixel(const CubeCamera& c, const Eigen::Vector2d& m) {
  const double radial = 1 + c.k1 * m.squaredNorm();
  return {c.focal * radial * m.x() + c.cx, c.focal * c.aspect * radial * m.y() + c.cy};
}

struct Placed {
  Dot dot;
  Eigen::Vector3d centre, along, down;
};

std::vector<Placed> box() {
  std::vector<Placed> all;
  for (const Dot& d : dots_of(Face::kTop)) {
    all.push_back({d, {d.column - 1.5, d.row - 1.5, 0}, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY()});
  }
  for (const Dot& d : dots_of(Face::kFront)) {
    all.push_back(
        {d, {d.column - 1.5, 2.2, 0.8 + d.row}, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()});
  }
  for (const Dot& d : dots_of(Face::kLeft)) {
    all.push_back(
        {d, {-2.2, d.column - 1.5, 0.8 + d.row}, Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ()});
  }
  return all;
}

TEST(EllipseCentre, IsTheMiddleOfTheProjectedCircle) {
  // A central symmetry: the extremes of an ellipse in any direction lie evenly about its centre.
  const SE3 pose = view(kViews - 1);
  const Eigen::Vector3d centre = pose * Eigen::Vector3d(1, 2.2, 2);
  const Eigen::Vector3d a = pose.rotation() * Eigen::Vector3d(3, 0, 0);
  const Eigen::Vector3d b = pose.rotation() * Eigen::Vector3d(0, 0, 3);
  const Eigen::Vector2d middle = ellipse_centre<double>(centre, a, b);
  for (const Eigen::Vector2d& direction : {Eigen::Vector2d(1, 0), {0, 1}, {0.6, 0.8}}) {
    double low = INFINITY, high = -INFINITY;
    constexpr int kSteps = 100000;
    for (int i = 0; i < kSteps; ++i) {
      const double angle = 2 * M_PI * i / kSteps;
      const double along =
          direction.dot((centre + std::cos(angle) * a + std::sin(angle) * b).eval().hnormalized());
      low = std::min(low, along);
      high = std::max(high, along);
    }
    EXPECT_NEAR(0.5 * (low + high), direction.dot(middle), 1e-8);
  }
  // The image of the circle's centre is elsewhere: the bias that the function is for.
  EXPECT_GT((middle - centre.hnormalized()).norm(), 1e-4);
}

TEST(FitToDots, FindsTheCameraWithinItsSigma) {
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise(0, kNoise);
  std::vector<DotSighting> sightings;
  for (int i = 0; i < kViews; ++i) {
    const SE3 pose = view(i);
    for (const Placed& p : box()) {
      const Eigen::Vector2d m =
          ellipse_centre<double>(pose * p.centre, kRadiusOfDots * (pose.rotation() * p.along),
                                 kRadiusOfDots * (pose.rotation() * p.down));
      sightings.push_back({i, p.dot, to_pixel(truth(), m) + Eigen::Vector2d{noise(random), noise(random)}});
    }
  }
  const auto fit = fit_to_dots(sightings, wrong_start(), freedom());
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_LT(fit->sigma.focal, 6);
  EXPECT_NEAR(fit->camera.focal, truth().focal, 4 * fit->sigma.focal) << "seed " << kSeed;
  EXPECT_NEAR(fit->camera.aspect, truth().aspect, 4 * fit->sigma.aspect);
  EXPECT_NEAR(fit->camera.k1, truth().k1, 4 * fit->sigma.k1);
  EXPECT_NEAR(fit->rms, kNoise, 0.3 * kNoise);
  EXPECT_NEAR(fit->box[kFrontDistance], 2.2, 0.02);
  EXPECT_NEAR(fit->box[kSideSpacing], 1, 0.01);
}

TEST(FitToTracks, FindsTheCameraOfAnUnknownScene) {
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise(0, kNoise);
  std::uniform_real_distribution<double> side(-8, 8), depth(0, 3);
  std::vector<SE3> poses;
  for (int i = 0; i < kViews; ++i) poses.push_back(view(i));
  std::vector<Track> tracks(120);
  for (Track& track : tracks) {
    const Eigen::Vector3d point(side(random), side(random), depth(random));
    for (int i = 0; i < kViews; ++i) {
      const Eigen::Vector2d pixel = to_pixel(truth(), (poses[static_cast<size_t>(i)] * point).hnormalized());
      track.sightings.push_back({i, pixel + Eigen::Vector2d{noise(random), noise(random)}});
    }
  }
  // A tenth of the tracks lie: they stick to the image.
  for (size_t i = 0; i < tracks.size(); i += 10) {
    for (Track::Sighting& s : tracks[i].sightings) s.pixel.x() += 0.3 * s.frame;
  }
  const auto fit = fit_to_tracks(tracks, {wrong_start(), poses, {}, 0}, freedom());
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_LT(fit->sigma.focal, 6);
  EXPECT_NEAR(fit->camera.focal, truth().focal, 4 * fit->sigma.focal) << "seed " << kSeed;
  EXPECT_NEAR(fit->camera.aspect, truth().aspect, 4 * fit->sigma.aspect);
  EXPECT_NEAR(fit->camera.k1, truth().k1, 4 * fit->sigma.k1);
}

TEST(Fits, SayWhenNothingIsDetermined) {
  EXPECT_FALSE(fit_to_dots({}, wrong_start(), freedom()));
  EXPECT_FALSE(fit_to_tracks({}, {}, freedom()));
}

TEST(DotCentroid, IsThatOfADiscOfLight) {
  constexpr int kSize = 40;
  for (const Eigen::Vector2d& centre : {Eigen::Vector2d(20.0, 20.0), {19.63, 20.21}, {20.4, 19.87}}) {
    GrayImage image(kSize, kSize);
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        int lit = 0;  // of 100 samples of the pixel
        for (int k = 0; k < 100; ++k) {
          const Eigen::Vector2d p(x - 0.45 + 0.1 * (k % 10), y - 0.45 + 0.1 * (k / 10));
          lit += (p - centre).norm() < 3 ? 1 : 0;
        }
        image.row(y)[x] = static_cast<uint8_t>(50 + 2 * lit);
      }
    }
    const auto found = dot_centroid(image.view(), centre + Eigen::Vector2d(1, -1));
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_LT((*found - centre).norm(), 0.02);
  }
  const GrayImage dark(kSize, kSize);
  EXPECT_FALSE(dot_centroid(dark.view(), {20, 20}));
}

TEST(Jackknife, OfAMeanIsItsStandardError) {
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  std::vector<double> sample(50);
  double sum = 0;
  for (double& v : sample) sum += v = normal(random);
  std::vector<double> without;
  double squares = 0;
  for (const double v : sample) {
    without.push_back((sum - v) / 49);
    squares += (v - sum / 50) * (v - sum / 50);
  }
  EXPECT_NEAR(jackknife_sigma(without), std::sqrt(squares / 49 / 50), 1e-12);
}

}  // namespace
}  // namespace cairn::cube
