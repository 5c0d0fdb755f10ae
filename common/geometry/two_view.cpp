// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/two_view.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "common/geometry/epipolar.h"
#include "common/geometry/sampling.h"
#include "common/geometry/triangulation.h"

namespace cairn {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr int kRefinements = 10;

/// Squared residuals of every match under the model, in units of sigma.
using Residuals = std::vector<double>;

tl::unexpected<TwoViewFailure> refuse(TwoViewRefusal reason, std::string message) {
  return tl::unexpected<TwoViewFailure>({reason, std::move(message)});
}

template <typename... Values>
std::string text(const char* format, Values... values) {
  std::array<char, 160> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, values...);
  return buffer.data();
}

/// Sum of truncated residuals (MSAC, Torr and Zisserman 2000); stops counting at `limit`.
template <typename Error>
double msac_cost(const NormalisedMatches& data, double cutoff, double limit, Error error) {
  double cost = 0;
  for (const auto& m : data.matches) {
    cost += std::min(error(m), cutoff);
    if (cost >= limit) break;
  }
  return cost;
}

template <size_t N>
std::array<NormalisedMatch, N> pick(const NormalisedMatches& data, const std::array<size_t, N>& indices) {
  std::array<NormalisedMatch, N> sample;
  for (size_t i = 0; i < N; ++i) sample[i] = data.matches[indices[i]];
  return sample;
}

struct Hypothesis {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  double cost = std::numeric_limits<double>::infinity();
};

double homography_cost(const NormalisedMatches& data, const Eigen::Matrix3d& H, double limit) {
  const Eigen::Matrix3d inverse = H.inverse();
  return msac_cost(data, kTransferCutoff, limit, [&](const NormalisedMatch& m) {
    return transfer_error(H, inverse, m, data.variance_a, data.variance_b);
  });
}

double essential_cost(const NormalisedMatches& data, const Eigen::Matrix3d& E, double limit) {
  return msac_cost(data, kEpipolarCutoff, limit, [&](const NormalisedMatch& m) {
    return sampson_error(E, m, data.variance_a, data.variance_b);
  });
}

std::optional<Eigen::Matrix3d> find_homography(const NormalisedMatches& data, const TwoViewOptions& options) {
  const double all_out = kTransferCutoff * static_cast<double>(data.matches.size());
  MinimalSampler sampler(options.seed, data.matches.size());
  Hypothesis best{Eigen::Matrix3d::Identity(), all_out};
  int trials = options.iterations;
  for (int trial = 0; trial < trials; ++trial) {
    Eigen::Matrix3d H;
    if (!solve_four_point(pick(data, sampler.draw<4>()), &H)) continue;
    if (const double cost = homography_cost(data, H, best.cost); cost < best.cost) {
      best = {H, cost};
      // A minimal sample carries the noise of four matches; all its inliers together do better.
      const Eigen::Matrix3d refined = refine_homography(data, H, 3);
      if (const double refined_cost = homography_cost(data, refined, best.cost); refined_cost < best.cost) {
        best = {refined, refined_cost};
      }
      trials = std::min(trials, required_trials(1 - best.cost / all_out, 4, options.iterations));
    }
  }
  if (best.cost >= all_out) return std::nullopt;
  return refine_homography(data, best.matrix, kRefinements);
}

/// Locally optimised RANSAC (Chum, Matas and Kittler 2003); the pose is one of the four of its essential
/// matrix.
std::optional<SE3> find_essential(const NormalisedMatches& data, const TwoViewOptions& options) {
  const double all_out = kEpipolarCutoff * static_cast<double>(data.matches.size());
  MinimalSampler sampler(options.seed, data.matches.size());
  std::optional<SE3> best;
  double best_cost = all_out;
  std::vector<Eigen::Matrix3d> solutions;
  int trials = options.iterations;
  for (int trial = 0; trial < trials; ++trial) {
    solutions.clear();
    solve_five_point(pick(data, sampler.draw<5>()), solutions);
    Hypothesis winner{Eigen::Matrix3d::Zero(), best_cost};
    for (const auto& E : solutions) {
      if (const double cost = essential_cost(data, E, winner.cost); cost < winner.cost) winner = {E, cost};
    }
    if (winner.cost >= best_cost) continue;
    const SE3 refined = refine_epipolar(data, pose_of_essential(winner.matrix), 4);
    best = refined;
    best_cost = std::min(winner.cost, essential_cost(data, essential_of(refined), all_out));
    trials = std::min(trials, required_trials(1 - best_cost / all_out, 5, options.iterations));
  }
  if (!best) return std::nullopt;
  return refine_epipolar(data, *best, kRefinements);
}

/// Torr's geometric robust information criterion ("An assessment of information criteria for motion model
/// selection", CVPR 1997) for a model with `dimension` of its manifold of matches and `freedom` parameters;
/// lower is better.
double gric(const Residuals& residuals, int dimension, int freedom) {
  const double n = static_cast<double>(residuals.size());
  const double limit = 2.0 * (4 - dimension);
  double sum = 0;
  for (const double r : residuals) sum += std::min(r, limit);
  return sum + std::log(4.0) * dimension * n + std::log(4 * n) * freedom;
}

Residuals transfer_residuals(const NormalisedMatches& data, const Eigen::Matrix3d& H) {
  Residuals residuals;
  residuals.reserve(data.matches.size());
  const Eigen::Matrix3d inverse = H.inverse();
  for (const auto& m : data.matches) {
    const double r = transfer_error(H, inverse, m, data.variance_a, data.variance_b);
    residuals.push_back(std::isfinite(r) ? r : std::numeric_limits<double>::infinity());
  }
  return residuals;
}

Residuals epipolar_residuals(const NormalisedMatches& data, const SE3& pose) {
  Residuals residuals;
  residuals.reserve(data.matches.size());
  const Eigen::Matrix3d E = essential_of(pose);
  for (const auto& m : data.matches)
    residuals.push_back(sampson_error(E, m, data.variance_a, data.variance_b));
  return residuals;
}

int count_below(const Residuals& residuals, double cutoff) {
  return static_cast<int>(
      std::count_if(residuals.begin(), residuals.end(), [&](double r) { return r < cutoff; }));
}

/// The three explanations of the matches, fitted side by side.
struct Models {
  std::optional<SE3> essential;
  std::optional<Eigen::Matrix3d> homography;
  std::optional<Eigen::Matrix3d> rotation;
  double gric_essential = std::numeric_limits<double>::infinity();
  double gric_homography = std::numeric_limits<double>::infinity();
  double gric_rotation = std::numeric_limits<double>::infinity();
  int rotation_inliers = 0;
};

Models fit_models(const NormalisedMatches& data, const TwoViewOptions& options) {
  Models models;
  models.homography = find_homography(data, options);
  if (models.homography) {
    models.gric_homography = gric(transfer_residuals(data, *models.homography), 2, 8);
    models.rotation = fit_rotation(data, *models.homography, 6);
    const Residuals residuals = transfer_residuals(data, *models.rotation);
    models.gric_rotation = gric(residuals, 2, 3);
    models.rotation_inliers = count_below(residuals, kTransferCutoff);
  }
  models.essential = find_essential(data, options);
  if (models.essential) models.gric_essential = gric(epipolar_residuals(data, *models.essential), 3, 5);
  return models;
}

/// Whether a match can lie in front of both cameras: ranges along both rays positive, or the rays so near to
/// parallel that the noise decides the sign.
bool may_be_in_front(const SE3& pose, const Eigen::Matrix3d& rotation, const NormalisedMatch& m,
                     double variance) {
  const Eigen::Vector3d a = rotation * m.a;
  const Eigen::Vector3d& t = pose.translation();
  // range_b b = range_a a + t, crossed with b and with a.
  const Eigen::Vector3d normal = a.cross(m.b);
  const double scale = a.squaredNorm() * m.b.squaredNorm();
  if (normal.squaredNorm() < 9 * variance * scale) return true;
  const double range_a = m.b.cross(t).dot(normal);
  const double range_b = a.cross(t).dot(normal);
  return range_a > 0 && range_b > 0;
}

/// A pose judged on all matches: truncated epipolar cost, in which a match behind a camera counts as an
/// outlier.
struct Candidate {
  SE3 pose;
  double cost = 0;
};

Candidate judge(const NormalisedMatches& data, const SE3& pose) {
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  const Residuals residuals = epipolar_residuals(data, pose);
  Candidate candidate{pose, 0};
  for (size_t i = 0; i < residuals.size(); ++i) {
    const bool good = residuals[i] < kEpipolarCutoff &&
                      may_be_in_front(pose, rotation, data.matches[i], data.variance_a + data.variance_b);
    candidate.cost += good ? residuals[i] : kEpipolarCutoff;
  }
  return candidate;
}

/// Motions of the refined homography for which the plane lies in front of the first camera at most of its
/// inliers.
std::vector<SE3> plane_motions(const NormalisedMatches& data, const Eigen::Matrix3d& H) {
  const Residuals residuals = transfer_residuals(data, H);
  std::vector<SE3> poses;
  for (const auto& motion : decompose_homography(H)) {
    int visible = 0;
    int inliers = 0;
    for (size_t i = 0; i < residuals.size(); ++i) {
      if (residuals[i] >= kTransferCutoff) continue;
      ++inliers;
      if (motion.normal.dot(data.matches[i].a) > 0) ++visible;
    }
    if (2 * visible > inliers) poses.push_back(motion.b_from_a);
  }
  return poses;
}

/// Candidates of the chosen model, best first. A plane: the homography's own motions, which are the
/// maximum-likelihood ones. Otherwise: the poses of the essential matrix and the plane's motions refined on
/// all matches, for a scene with one big plane has a second minimum there.
std::vector<Candidate> candidates_of(const NormalisedMatches& data, const Models& models,
                                     TwoViewModel model) {
  std::vector<SE3> poses;
  if (models.homography) poses = plane_motions(data, *models.homography);
  if (model == TwoViewModel::kEssential) {
    for (SE3& pose : poses) pose = refine_epipolar(data, pose, kRefinements);
    for (const SE3& pose : twisted_poses(*models.essential)) poses.push_back(pose);
  }
  std::vector<Candidate> candidates;
  candidates.reserve(poses.size());
  for (const SE3& pose : poses) candidates.push_back(judge(data, pose));
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& x, const Candidate& y) { return x.cost < y.cost; });
  return candidates;
}

bool same_motion(const SE3& x, const SE3& y) {
  constexpr double kSameRotation = 2 / kDegrees;
  constexpr double kSameDirection = 10 / kDegrees;
  return x.rotation().angularDistance(y.rotation()) < kSameRotation &&
         parallax(Eigen::Vector3d::Zero(), x.translation(), y.translation()) < kSameDirection;
}

/// Support (matches explained, 0..n) of the best candidate's strongest rival over its own; 0 where the costs
/// differ by so much that the noise cannot have made the choice.
double ambiguity(const std::vector<Candidate>& candidates, size_t matches) {
  const double n = static_cast<double>(matches);
  const double decisive =
      std::max(30.0, 0.1 * n);  // units of sigma^2; a tenth per match for imperfect calibration
  for (size_t i = 1; i < candidates.size(); ++i) {
    if (same_motion(candidates[0].pose, candidates[i].pose)) continue;
    if (candidates[i].cost - candidates[0].cost > decisive) return 0;
    return (n - candidates[i].cost / kEpipolarCutoff) / (n - candidates[0].cost / kEpipolarCutoff);
  }
  return 0;
}

/// Points of the matches under the pose, and how many of those that fit it have one.
struct Structure {
  TwoViewGeometry geometry;
  double good_fraction = 0;  ///< of the matches that fit and are not too near to infinity to tell
};

Structure build_structure(const Camera& camera_a, const Camera& camera_b, std::span<const PixelMatch> matches,
                          std::span<const size_t> index, const NormalisedMatches& data, const SE3& pose,
                          const TwoViewOptions& options) {
  const double limit = 16 * options.sigma * options.sigma;
  Structure result;
  TwoViewGeometry& geometry = result.geometry;
  geometry.b_from_a = pose;
  geometry.points.assign(matches.size(), Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  geometry.inlier.assign(matches.size(), false);
  const Residuals residuals = epipolar_residuals(data, pose);
  const Eigen::Vector3d center_b = pose.center();
  std::vector<double> parallaxes;
  int fitting = 0;
  for (size_t i = 0; i < index.size(); ++i) {
    if (residuals[i] >= kEpipolarCutoff) continue;
    const NormalisedMatch& m = data.matches[i];
    const auto point = triangulate(pose, m.a.normalized(), m.b.normalized());
    if (!point) {
      const bool certain =
          !may_be_in_front(pose, pose.rotation_matrix(), m, data.variance_a + data.variance_b);
      fitting += certain ? 1 : 0;
      continue;
    }
    ++fitting;
    const auto in_a = camera_a.project(*point);
    const auto in_b = camera_b.project(pose * *point);
    const PixelMatch& match = matches[index[i]];
    if (!in_a || !in_b || (*in_a - match.a).squaredNorm() > limit || (*in_b - match.b).squaredNorm() > limit)
      continue;
    geometry.points[index[i]] = *point;
    geometry.inlier[index[i]] = true;
    ++geometry.inliers;
    parallaxes.push_back(parallax(*point, Eigen::Vector3d::Zero(), center_b));
  }
  if (!parallaxes.empty()) {
    const auto middle = parallaxes.begin() + static_cast<std::ptrdiff_t>(parallaxes.size() / 2);
    std::nth_element(parallaxes.begin(), middle, parallaxes.end());
    geometry.median_parallax = *middle;
  }
  result.good_fraction = fitting > 0 ? static_cast<double>(geometry.inliers) / fitting : 0;
  return result;
}

/// Finite matches as points of the ideal camera; `index` has their places in `matches`.
NormalisedMatches normalise(const Camera& camera_a, const Camera& camera_b,
                            std::span<const PixelMatch> matches, double sigma, std::vector<size_t>* index) {
  NormalisedMatches data;
  data.matches.reserve(matches.size());
  index->reserve(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!matches[i].a.allFinite() || !matches[i].b.allFinite()) continue;
    const Eigen::Vector3d a = camera_a.unproject(matches[i].a);
    const Eigen::Vector3d b = camera_b.unproject(matches[i].b);
    data.matches.push_back({a / a.z(), b / b.z()});
    index->push_back(i);
  }
  data.variance_a = std::pow(sigma / camera_a.focal_length(), 2);
  data.variance_b = std::pow(sigma / camera_b.focal_length(), 2);
  return data;
}

/// The camera turned or stood: which of the two, in words.
TwoViewFailure rotation_failure(const Eigen::Matrix3d& rotation, double sigma_angle) {
  const double angle = so3_log(Eigen::Quaterniond(rotation)).norm();
  if (angle < 3 * sigma_angle) return {TwoViewRefusal::kNoParallax, "no parallax: the camera stands still"};
  return {TwoViewRefusal::kRotationOnly,
          text("no parallax: the camera only turned, by %.1f degrees", angle * kDegrees)};
}

}  // namespace

tl::expected<TwoViewGeometry, TwoViewFailure> estimate_two_view(const Camera& camera_a,
                                                                const Camera& camera_b,
                                                                std::span<const PixelMatch> matches,
                                                                const TwoViewOptions& options) {
  std::vector<size_t> index;
  const NormalisedMatches data = normalise(camera_a, camera_b, matches, options.sigma, &index);
  constexpr int kMinimalSample = 5;
  const auto count = static_cast<int>(data.matches.size());
  if (count < std::max(options.min_matches, kMinimalSample)) {
    return refuse(TwoViewRefusal::kTooFewMatches,
                  text("%d matches, at least %d needed", count, options.min_matches));
  }

  const Models models = fit_models(data, options);
  const double enough = options.min_inlier_fraction * count;
  if (models.rotation_inliers >= enough &&
      models.gric_rotation <= std::min(models.gric_essential, models.gric_homography)) {
    return tl::unexpected(rotation_failure(*models.rotation, std::sqrt(data.variance_a)));
  }
  if (!models.essential) return refuse(TwoViewRefusal::kNoModel, "no two-view model fits the matches");
  const auto model =
      models.gric_homography < models.gric_essential ? TwoViewModel::kHomography : TwoViewModel::kEssential;
  const auto candidates = candidates_of(data, models, model);
  if (candidates.empty())
    return refuse(TwoViewRefusal::kNoModel, "no motion puts the plane in front of both cameras");

  Structure structure =
      build_structure(camera_a, camera_b, matches, index, data, candidates[0].pose, options);
  structure.geometry.model = model;
  const int fitting = count_below(epipolar_residuals(data, candidates[0].pose), kEpipolarCutoff);
  if (fitting < enough) {
    return refuse(TwoViewRefusal::kNoModel, text("only %d of %d matches fit one motion", fitting, count));
  }
  if (const double angle = structure.geometry.median_parallax; angle < options.min_median_parallax) {
    return refuse(TwoViewRefusal::kNoParallax,
                  text("no parallax: %.1f degrees, %.1f needed", angle * kDegrees,
                       options.min_median_parallax * kDegrees));
  }
  if (structure.good_fraction < options.min_good_fraction) {
    return refuse(TwoViewRefusal::kNoModel, text("only %.0f %% of the matches lie in front of both cameras",
                                                 100 * structure.good_fraction));
  }
  if (const double rival = ambiguity(candidates, data.matches.size()); rival > options.max_ambiguity) {
    return refuse(TwoViewRefusal::kAmbiguous,
                  text("two motions explain the matches, the second %.0f %% as well", 100 * rival));
  }
  return std::move(structure.geometry);
}

}  // namespace cairn
