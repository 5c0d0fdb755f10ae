// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/two_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <ostream>
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
  return random.uniform(0.5, 1.5);
}

/// find_motions() and build_two_view() of the best, refused as ambiguous when it has rivals.
tl::expected<TwoViewGeometry, TwoViewFailure> estimate_two_view(const Camera& camera_a,
                                                                const Camera& camera_b,
                                                                std::span<const PixelMatch> matches,
                                                                const TwoViewOptions& options = {}) {
  const auto motions = find_motions(camera_a, camera_b, matches, options);
  if (!motions) return tl::unexpected(motions.error());
  auto geometry = build_two_view(camera_a, camera_b, matches, motions->b_from_a.front(), options);
  if (geometry && !motions->decided) {
    return tl::unexpected(TwoViewFailure{TwoViewRefusal::kAmbiguous, "rivals"});
  }
  return geometry;
}

struct Conditions {
  CameraParameters camera{CameraModel::kPinholeRadtan, 640, 480, {525, 525, 319.5, 239.5}};
  DepthOf depth = general_depth;
  double baseline = 2 * kDegree;  ///< as parallax at depth 1
  double rotation = 3 * kDegree;
  double forward = 0.1;  ///< spread of the motion along the optical axis, of that across
  double noise = 0.5;    ///< px in each image
  double outliers = 0.1;
  int matches = 300;
};

struct Pair {
  CameraPtr camera;
  SE3 b_from_a;
  std::vector<PixelMatch> matches;
  std::vector<bool> outlier;
};

/// A hand that moves sideways in a random direction and turns a little about a random axis.
Pair make_pair(const Conditions& setup, unsigned seed) {
  Random random(seed);
  Pair pair;
  pair.camera = make_camera(setup.camera).value();
  const Eigen::Vector3d across =
      random.vector().cwiseProduct(Eigen::Vector3d(1, 1, setup.forward)).normalized();
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
    const Eigen::Vector2d noise_a = setup.noise * Eigen::Vector2d{random.normal(), random.normal()};
    const Eigen::Vector2d noise_b = setup.noise * Eigen::Vector2d{random.normal(), random.normal()};
    pair.matches.push_back({pixel + noise_a, measured + noise_b});
    pair.outlier.push_back(outlier);
  }
  return pair;
}

TwoViewOptions options_for(const Conditions& setup) {
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
int good_starts(const Conditions& setup, double max_rotation_error, double max_direction_error,
                std::string* log) {
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
  Conditions setup;
  double max_rotation_error = 0.5;    ///< [degree]
  double max_direction_error = 10.0;  ///< [degree]
};

void PrintTo(const Scenario& scenario, std::ostream* out) {
  *out << scenario.name;
}

class Starts : public ::testing::TestWithParam<Scenario> {};

Conditions with(const std::function<void(Conditions&)>& change) {
  Conditions setup;
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
    ::testing::Values(
        Scenario{"GeneralDepth", with([](Conditions& s) { s.depth = general_depth; })},
        Scenario{"Plane", with([](Conditions& s) { s.depth = plane_depth; })},
        Scenario{"FrontalPlane", with([](Conditions& s) { s.depth = frontal_plane_depth; })},
        Scenario{"BoxOnPlane", with([](Conditions& s) { s.depth = box_on_plane_depth; })},
        Scenario{"GeneralDepthThirtyPercentOutliers", with([](Conditions& s) { s.outliers = 0.3; })},
        Scenario{"PlaneThirtyPercentOutliers",
                 with([](Conditions& s) { s.depth = plane_depth, s.outliers = 0.3; })},
        Scenario{"GeneralDepthOnePixelNoise",
                 with([](Conditions& s) { s.noise = 1, s.baseline = 4 * kDegree; })},
        Scenario{"PlaneOnePixelNoise",
                 with([](Conditions& s) { s.depth = plane_depth, s.noise = 1, s.baseline = 4 * kDegree; })},
        Scenario{"SmallImageGeneral",
                 with([](Conditions& s) { s.camera = kCube, s.baseline = 3 * kDegree, s.matches = 200; })},
        Scenario{"SmallImagePlane", with([](Conditions& s) {
                   s.camera = kCube, s.depth = plane_depth, s.baseline = 3 * kDegree, s.matches = 200;
                 })},
        Scenario{"DistortedCamera", with([](Conditions& s) { s.camera = kEuroc; })},
        Scenario{"DistortedCameraBoxOnPlane", with([](Conditions& s) {
                   s.camera = kEuroc, s.depth = box_on_plane_depth, s.baseline = 2.5 * kDegree;
                 })},
        Scenario{"FewMatches", with([](Conditions& s) { s.matches = 60, s.baseline = 5 * kDegree; })},
        Scenario{"WideBaseline", with([](Conditions& s) { s.baseline = 15 * kDegree; })}),
    [](const auto& tested) { return tested.param.name; });

TEST_P(Starts, AtLeast95Of100SeedsAreGood) {
  const auto& [name, setup, max_rotation_error, max_direction_error] = GetParam();
  std::string log;
  EXPECT_GE(good_starts(setup, max_rotation_error, max_direction_error, &log), 95) << log;
}

/// How `seeds` pairs end; wrong: more than 15 degrees off in direction.
struct Endings {
  int good = 0;
  int wrong = 0;
  std::map<TwoViewRefusal, int> refused;
};

Endings endings(const Conditions& setup, unsigned seeds = 100) {
  Endings result;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const Pair pair = make_pair(setup, seed);
    const auto found = estimate_two_view(*pair.camera, *pair.camera, pair.matches, options_for(setup));
    if (!found) {
      EXPECT_FALSE(found.error().message.empty());
      ++result.refused[found.error().reason];
    } else if (direction_error(pair, *found) > 15) {
      ++result.wrong;
    } else {
      ++result.good;
    }
  }
  return result;
}

TEST(TwoView, PureRotationWithNoiseIsRefusedAsSuch) {
  for (const double noise : {0.3, 0.5, 1.0}) {
    for (const double outliers : {0.0, 0.3}) {
      for (const double rotation : {1.0, 5.0, 10.0}) {
        Conditions setup;
        setup.baseline = 0;
        setup.rotation = rotation * kDegree;
        setup.noise = noise;
        setup.outliers = outliers;
        Endings result = endings(setup, 40);
        EXPECT_EQ(result.good + result.wrong, 0) << "noise " << noise << " rotation " << rotation;
        EXPECT_GE(result.refused[TwoViewRefusal::kRotationOnly], 36)
            << "noise " << noise << " rotation " << rotation;
      }
    }
  }
}

TEST(TwoView, AStandingCameraIsRefusedForLackOfParallax) {
  for (const double noise : {0.0, 0.5, 1.0}) {
    Conditions setup;
    setup.baseline = 0;
    setup.rotation = 0;
    setup.noise = noise;
    EXPECT_EQ(endings(setup).refused[TwoViewRefusal::kNoParallax], 100) << "noise " << noise;
  }
}

TEST(TwoView, LittleParallaxUnderRotationIsRefused) {
  for (const DepthOf& depth : {DepthOf(general_depth), DepthOf(plane_depth)}) {
    Conditions setup;
    setup.depth = depth;
    setup.baseline = 0.4 * kDegree;
    const Endings result = endings(setup);
    EXPECT_EQ(result.good + result.wrong, 0);
  }
}

// A plane has two motions (Faugeras and Lustman 1988). Where the second has all points in front of both
// cameras, as for a motion along the axis in a narrow view, nothing in two views tells them apart.
TEST(TwoView, AForwardMotionOverAPlaneIsRefusedRatherThanGuessed) {
  for (const CameraParameters& camera : {kCube, kEuroc}) {
    for (const double noise : {0.5, 1.0}) {
      Conditions setup;
      setup.camera = camera;
      setup.depth = plane_depth;
      setup.forward = 1.0;
      setup.noise = noise;
      setup.baseline = 4 * kDegree;
      const Endings result = endings(setup);
      EXPECT_LE(result.wrong, 2) << "noise " << noise;
      EXPECT_LT(result.good, 100);
    }
  }
}

TEST(TwoView, RandomMatchesAreRefused) {
  Conditions setup;
  setup.outliers = 1.0;
  const Endings result = endings(setup);
  EXPECT_EQ(result.good + result.wrong, 0);
}

TEST(TwoView, ModelIsTheScenes) {
  const auto has_model = [](const Conditions& setup, unsigned seed, TwoViewModel model) {
    const Pair pair = make_pair(setup, seed);
    const auto motions = find_motions(*pair.camera, *pair.camera, pair.matches, options_for(setup));
    return motions && motions->model == model;
  };
  Conditions plane;
  plane.depth = plane_depth;
  int planes = 0;
  int general = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    planes += has_model(plane, seed, TwoViewModel::kHomography) ? 1 : 0;
    general += has_model(Conditions(), seed, TwoViewModel::kEssential) ? 1 : 0;
  }
  EXPECT_GE(planes, 47);
  EXPECT_GE(general, 49);
}

TEST(TwoView, StructureIsConsistentWithThePoseAndTheMatches) {
  const Conditions setup;
  const Pair pair = make_pair(setup, 3);
  const auto found = estimate_two_view(*pair.camera, *pair.camera, pair.matches, options_for(setup));
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_NEAR(found->b_from_a.translation().norm(), 1, 1e-12);
  ASSERT_EQ(found->points.size(), pair.matches.size());
  ASSERT_EQ(found->inlier.size(), pair.matches.size());
  int inliers = 0;
  int accepted_outliers = 0;
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    if (!found->inlier[i]) {
      EXPECT_FALSE(found->points[i].allFinite()) << i;
      continue;
    }
    ++inliers;
    accepted_outliers += pair.outlier[i] ? 1 : 0;
    const auto in_a = pair.camera->project(found->points[i]);
    const auto in_b = pair.camera->project(found->b_from_a * found->points[i]);
    ASSERT_TRUE(in_a && in_b) << i;
    EXPECT_LT((*in_a - pair.matches[i].a).norm(), 4 * setup.noise) << i;
    EXPECT_LT((*in_b - pair.matches[i].b).norm(), 4 * setup.noise) << i;
  }
  EXPECT_EQ(inliers, found->inliers);
  EXPECT_GE(inliers, 250);
  EXPECT_LE(accepted_outliers, 8);
  EXPECT_GT(found->median_parallax, 1.2 * kDegree);
  EXPECT_LT(found->median_parallax, 4 * kDegree);
}

TEST(TwoView, SameSeedSameBytes) {
  const Pair pair = make_pair(Conditions(), 5);
  const auto first = estimate_two_view(*pair.camera, *pair.camera, pair.matches);
  const auto second = estimate_two_view(*pair.camera, *pair.camera, pair.matches);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->b_from_a.rotation().coeffs(), second->b_from_a.rotation().coeffs());
  EXPECT_EQ(first->b_from_a.translation(), second->b_from_a.translation());
  EXPECT_EQ(first->inlier, second->inlier);
}

TEST(TwoView, TwoCamerasOfDifferentFocalLengthWork) {
  Conditions setup;
  const Pair pair = make_pair(setup, 8);
  const auto half =
      make_camera({CameraModel::kPinholeRadtan, 320, 240, {262.5, 262.5, 159.5, 119.5}}).value();
  std::vector<PixelMatch> matches = pair.matches;
  for (auto& m : matches) m.b = 0.5 * (m.b - Eigen::Vector2d(319.5, 239.5)) + Eigen::Vector2d(159.5, 119.5);
  const auto found = estimate_two_view(*pair.camera, *half, matches, options_for(setup));
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(rotation_error(pair, *found), 0.5);
  EXPECT_LT(direction_error(pair, *found), 10);
}

TEST(TwoView, TooFewAndNonFiniteMatchesAreRefused) {
  Pair pair = make_pair(Conditions(), 1);
  const auto few = estimate_two_view(*pair.camera, *pair.camera, std::span(pair.matches).first(39));
  ASSERT_FALSE(few);
  EXPECT_EQ(few.error().reason, TwoViewRefusal::kTooFewMatches);
  EXPECT_FALSE(estimate_two_view(*pair.camera, *pair.camera, {}));
  for (size_t i = 39; i < pair.matches.size(); ++i)
    pair.matches[i].b.x() = std::numeric_limits<double>::quiet_NaN();
  const auto broken = estimate_two_view(*pair.camera, *pair.camera, pair.matches);
  ASSERT_FALSE(broken);
  EXPECT_EQ(broken.error().reason, TwoViewRefusal::kTooFewMatches);
}

TEST(TwoView, MatchesInOnePlaceOrOnALineDoNotHurt) {
  const auto camera = make_camera(Conditions().camera).value();
  const std::vector<PixelMatch> place(100, {{100, 100}, {110, 100}});
  std::vector<PixelMatch> line;
  for (int i = 0; i < 100; ++i) line.push_back({{5.0 * i, 50.0 + 3 * i}, {5.0 * i + 8, 50.0 + 3 * i}});
  EXPECT_FALSE(estimate_two_view(*camera, *camera, place));
  EXPECT_FALSE(estimate_two_view(*camera, *camera, line));
}

// --- the parts ---

NormalizedMatch exact_match(const SE3& b_from_a, Random& random) {
  const Eigen::Vector3d p(random.uniform(-0.6, 0.6), random.uniform(-0.5, 0.5), random.uniform(0.8, 2));
  const Eigen::Vector3d q = b_from_a * p;
  return {.a = p / p.z(), .b = q / q.z()};
}

TEST(FivePoint, TrueEssentialMatrixIsAmongTheSolutionsAndAllAreEssential) {
  int solved = 0;
  constexpr unsigned kTrials = 500;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    Random random(seed);
    const SE3 b_from_a(so3_exp(0.2 * random.vector()), 0.3 * random.vector());
    std::array<NormalizedMatch, 5> sample;
    for (auto& m : sample) m = exact_match(b_from_a, random);
    const Eigen::Matrix3d truth = essential_of(b_from_a).normalized();
    std::vector<Eigen::Matrix3d> solutions;
    solve_five_point(sample, solutions);
    EXPECT_LE(solutions.size(), 10U);
    double closest = 1;
    for (const auto& E : solutions) {
      closest = std::min({closest, (E - truth).norm(), (E + truth).norm()});
      for (const auto& m : sample) EXPECT_LT(std::abs(m.b.dot(E * m.a)), 1e-9) << "seed " << seed;
    }
    solved += closest < 1e-6 ? 1 : 0;
  }
  EXPECT_GE(solved, static_cast<int>(kTrials * 99 / 100));
}

TEST(Essential, FourPosesShareTheMatrixAndOneIsTheTruth) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    Random random(seed);
    const SE3 truth(so3_exp(random.vector()), random.vector().normalized());
    const Eigen::Matrix3d E = essential_of(truth);
    int hits = 0;
    for (const SE3& pose : twisted_poses(pose_of_essential(E))) {
      const Eigen::Matrix3d again = essential_of(pose);
      EXPECT_LT(std::min((again - E).norm(), (again + E).norm()), 1e-12) << "seed " << seed;
      hits += (pose * truth.inverse()).log().norm() < 1e-7 ? 1 : 0;
    }
    EXPECT_EQ(hits, 1) << "seed " << seed;
  }
}

TEST(Essential, RefinementReachesTheTruthWithoutNoise) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    Random random(seed);
    const SE3 truth(so3_exp(0.1 * random.vector()), random.vector().normalized());
    std::vector<NormalizedMatch> data;
    const SE3 scaled(truth.rotation(), 0.1 * truth.translation());
    for (int i = 0; i < 100; ++i) data.push_back(exact_match(scaled, random));
    const SE3 start(so3_exp(0.0005 * random.vector()) * truth.rotation(),
                    (truth.translation() + 0.01 * random.vector()).normalized());
    const SE3 refined = refine_epipolar(data, start, 30);
    EXPECT_LT((refined * truth.inverse()).log().norm(), 1e-4) << "seed " << seed;
  }
}

TEST(Homography, FourPointsGiveItAndItsMotionIsAmongTheDecompositions) {
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Random random(seed);
    const SE3 b_from_a(so3_exp(0.1 * random.vector()), 0.1 * random.vector());
    const Eigen::Vector3d normal =
        (Eigen::Vector3d(0, 0, 2) + random.vector().cwiseMin(1).cwiseMax(-1)).normalized();
    const Eigen::Matrix3d truth =
        (b_from_a.rotation_matrix() + b_from_a.translation() * normal.transpose()).normalized();
    std::array<NormalizedMatch, 4> sample;
    constexpr std::array<std::array<double, 2>, 4> kCorners{
        {{-0.4, -0.3}, {0.4, -0.3}, {0.35, 0.3}, {-0.4, 0.25}}};
    for (size_t i = 0; i < 4; ++i) {
      sample[i].a = {kCorners[i][0], kCorners[i][1], 1};
      sample[i].b = truth * sample[i].a;
      sample[i].b /= sample[i].b.z();
    }
    Eigen::Matrix3d H;
    ASSERT_TRUE(solve_four_point(sample, &H)) << "seed " << seed;
    EXPECT_LT(std::min((H - truth).norm(), (H + truth).norm()), 1e-9) << "seed " << seed;
    double closest = 1e9;
    for (const auto& motion : decompose_homography(H)) {
      const SE3 unit(b_from_a.rotation(), b_from_a.translation().normalized());
      closest = std::min(closest,
                         (motion.b_from_a * unit.inverse()).log().norm() + (motion.normal - normal).norm());
    }
    EXPECT_LT(closest, 1e-6) << "seed " << seed;
  }
}

TEST(Homography, CollinearAndMirroredSamplesAreRefused) {
  std::array<NormalizedMatch, 4> sample;
  const std::array<Eigen::Vector3d, 4> corners{Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.1, 0, 1),
                                               Eigen::Vector3d(0.2, 0, 1), Eigen::Vector3d(0, 0.3, 1)};
  for (size_t i = 0; i < 4; ++i) sample[i].a = sample[i].b = corners[i];
  Eigen::Matrix3d H;
  EXPECT_FALSE(solve_four_point(sample, &H));
  sample[2].a = sample[2].b = Eigen::Vector3d(0.2, 0.3, 1);
  EXPECT_TRUE(solve_four_point(sample, &H));
  std::swap(sample[0].b, sample[1].b);
  EXPECT_FALSE(solve_four_point(sample, &H));
}

TEST(Homography, OfARotationHasNoDecompositionAndIsThatRotation) {
  const Eigen::Matrix3d rotation = so3_exp({0.1, -0.2, 0.05}).toRotationMatrix();
  EXPECT_TRUE(decompose_homography(3 * rotation).empty());
  std::vector<NormalizedMatch> data;
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d a(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), 1);
    const Eigen::Vector3d b = rotation * a;
    data.push_back({.a = a, .b = b / b.z()});
  }
  const Eigen::Matrix3d nearby = so3_exp({0.004, 0.002, -0.003}).toRotationMatrix() * rotation;
  EXPECT_LT((fit_rotation(data, nearby, 10) - rotation).norm(), 1e-9);
}

}  // namespace
}  // namespace cairn
