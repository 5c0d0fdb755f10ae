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

#include "common/base/median.h"
#include "common/geometry/epipolar.h"
#include "common/geometry/ransac.h"
#include "common/geometry/robust.h"
#include "common/geometry/triangulation.h"

namespace cairn {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr int kRefinements = 10;
constexpr double kLeastSigma = 0.15;   ///< [px]
constexpr double kRivalSupport = 0.8;  ///< of the best motion's: a motion with less is no rival
constexpr double kMaxDirectionUncertainty = 20 / kDegrees;  ///< one sigma of the direction of the translation

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

template <size_t N>
std::array<NormalizedMatch, N> pick(NormalizedMatches matches, const std::array<size_t, N>& indices) {
  std::array<NormalizedMatch, N> sample;
  for (size_t i = 0; i < N; ++i) sample[i] = matches[indices[i]];
  return sample;
}

double homography_cost(NormalizedMatches matches, const Eigen::Matrix3d& H, double limit) {
  const Eigen::Matrix3d inverse = H.inverse();
  return truncated_cost(matches, kTransferCutoff, limit,
                        [&](const NormalizedMatch& m) { return transfer_error(H, inverse, m); });
}

double essential_cost(NormalizedMatches matches, const Eigen::Matrix3d& E, double limit) {
  return truncated_cost(matches, kEpipolarCutoff, limit,
                        [&](const NormalizedMatch& m) { return sampson_error(E, m); });
}

RansacOptions drawing_of(NormalizedMatches matches, double cutoff, const TwoViewOptions& options) {
  RansacOptions drawing;
  drawing.population = matches.size();
  drawing.all_outliers = cutoff * static_cast<double>(matches.size());
  drawing.most_trials = options.iterations;
  drawing.seed = options.seed;
  return drawing;
}

/// The homography of four matches, refined by all its inliers where that pays: a minimal sample carries the
/// noise of four.
std::optional<Hypothesis<Eigen::Matrix3d>> homography_of(NormalizedMatches matches,
                                                         const std::array<size_t, 4>& sample, double limit) {
  Eigen::Matrix3d H;
  if (!solve_four_point(pick(matches, sample), &H)) return std::nullopt;
  const double cost = homography_cost(matches, H, limit);
  if (!(cost < limit)) return std::nullopt;
  const Eigen::Matrix3d refined = refine_homography(matches, H, 3);
  const double refined_cost = homography_cost(matches, refined, cost);
  if (refined_cost < cost) return Hypothesis<Eigen::Matrix3d>{refined, refined_cost};
  return Hypothesis<Eigen::Matrix3d>{H, cost};
}

std::optional<Eigen::Matrix3d> find_homography(NormalizedMatches matches, const TwoViewOptions& options) {
  const auto best = ransac<4, Eigen::Matrix3d>(drawing_of(matches, kTransferCutoff, options),
                                               [&](const std::array<size_t, 4>& sample, double limit) {
                                                 return homography_of(matches, sample, limit);
                                               });
  if (!best) return std::nullopt;
  return refine_homography(matches, *best, kRefinements);
}

/// The best essential matrix of five matches; the pose is one of its four, refined by all its inliers.
std::optional<Hypothesis<SE3>> epipolar_of(NormalizedMatches matches, const std::array<size_t, 5>& sample,
                                           double limit) {
  std::vector<Eigen::Matrix3d> solutions;
  solve_five_point(pick(matches, sample), solutions);
  std::optional<Hypothesis<Eigen::Matrix3d>> winner;
  for (const auto& E : solutions) {
    const double least = winner ? winner->cost : limit;
    if (const double cost = essential_cost(matches, E, least); cost < least) winner = {E, cost};
  }
  if (!winner) return std::nullopt;
  const SE3 refined = refine_epipolar(matches, pose_of_essential(winner->model), 4);
  const double refined_cost = essential_cost(matches, essential_of(refined), winner->cost);
  return Hypothesis<SE3>{refined, std::min(winner->cost, refined_cost)};
}

std::optional<SE3> find_essential(NormalizedMatches matches, const TwoViewOptions& options) {
  const auto best = ransac<5, SE3>(
      drawing_of(matches, kEpipolarCutoff, options),
      [&](const std::array<size_t, 5>& sample, double limit) { return epipolar_of(matches, sample, limit); });
  if (!best) return std::nullopt;
  return refine_epipolar(matches, *best, kRefinements);
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

Residuals transfer_residuals(NormalizedMatches matches, const Eigen::Matrix3d& H) {
  Residuals residuals;
  residuals.reserve(matches.size());
  const Eigen::Matrix3d inverse = H.inverse();
  for (const auto& m : matches) {
    const double r = transfer_error(H, inverse, m);
    residuals.push_back(std::isfinite(r) ? r : std::numeric_limits<double>::infinity());
  }
  return residuals;
}

Residuals epipolar_residuals(NormalizedMatches matches, const SE3& pose) {
  Residuals residuals;
  residuals.reserve(matches.size());
  const Eigen::Matrix3d E = essential_of(pose);
  for (const auto& m : matches) residuals.push_back(sampson_error(E, m));
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

Models fit_models(NormalizedMatches matches, const TwoViewOptions& options) {
  Models models;
  models.homography = find_homography(matches, options);
  if (models.homography) {
    models.gric_homography = gric(transfer_residuals(matches, *models.homography), 2, 8);
    models.rotation = fit_rotation(matches, *models.homography, 6);
    const Residuals residuals = transfer_residuals(matches, *models.rotation);
    models.gric_rotation = gric(residuals, 2, 3);
    models.rotation_inliers = count_below(residuals, kTransferCutoff);
  }
  models.essential = find_essential(matches, options);
  if (models.essential) models.gric_essential = gric(epipolar_residuals(matches, *models.essential), 3, 5);
  return models;
}

/// Whether the rays of a match meet in front of both cameras: range_b b = range_a R a + t with positive
/// ranges.
bool meets_in_front(const Eigen::Vector3d& rotated_a, const Eigen::Vector3d& t, const Eigen::Vector3d& b) {
  const Eigen::Vector3d normal = rotated_a.cross(b);
  return b.cross(t).dot(normal) > 0 && rotated_a.cross(t).dot(normal) > 0;
}

/// Squared error of a match whose point lies in front of both cameras, in units of sigma. A match that meets
/// behind them is best explained at infinity: far points, whose noise decides the sign, stay cheap, and no
/// threshold is needed.
double frontal_error(const SE3& pose, const Eigen::Matrix3d& rotation, const NormalizedMatch& m,
                     double epipolar_residual) {
  const Eigen::Vector3d a = rotation * m.a;
  if (meets_in_front(a, pose.translation(), m.b)) return epipolar_residual;
  if (!(a.z() > 0)) return std::numeric_limits<double>::infinity();
  return (a.head<2>() / a.z() - m.b.head<2>()).squaredNorm() / (m.variance_a + m.variance_b);
}

/// A pose judged on all matches.
struct Candidate {
  SE3 pose;
  Residuals epipolar;  ///< Sampson errors; for matches of the plane, if there is one, their distance from it
  Residuals frontal;   ///< frontal_error(), at most the cut-off
  double cost = 0;     ///< sum of `frontal`
};

/// `plane`: transfer residuals under the homography that all candidates share, or none. On it they differ
/// only by the side of the camera. Their Sampson errors there are noise of two different directions and must
/// not decide.
Candidate judge(NormalizedMatches matches, const SE3& pose, const Residuals& plane) {
  constexpr double kWiderCutoff = 2 * kTransferCutoff;  // the tail of the inliers is no evidence either
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  Candidate candidate{pose, epipolar_residuals(matches, pose), {}, 0};
  for (size_t i = 0; i < plane.size(); ++i) {
    if (plane[i] < kWiderCutoff) candidate.epipolar[i] = std::min(plane[i], kEpipolarCutoff);
  }
  candidate.frontal.reserve(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const double error = frontal_error(pose, rotation, matches[i], candidate.epipolar[i]);
    candidate.frontal.push_back(std::min(error, kEpipolarCutoff));
    candidate.cost += candidate.frontal.back();
  }
  return candidate;
}

/// Motions of the refined homography for which the plane lies in front of the first camera at most of its
/// inliers.
std::vector<SE3> plane_motions(NormalizedMatches matches, const Eigen::Matrix3d& H) {
  const Residuals residuals = transfer_residuals(matches, H);
  std::vector<SE3> poses;
  for (const auto& motion : decompose_homography(H)) {
    int visible = 0;
    int inliers = 0;
    for (size_t i = 0; i < residuals.size(); ++i) {
      if (residuals[i] >= kTransferCutoff) continue;
      ++inliers;
      if (motion.normal.dot(matches[i].a) > 0) ++visible;
    }
    if (2 * visible > inliers) poses.push_back(motion.b_from_a);
  }
  return poses;
}

/// Candidates of the chosen model, best first. A plane: the homography's own motions, which are the
/// maximum-likelihood ones. Otherwise: the poses of the essential matrix and the plane's motions refined on
/// all matches, for a scene with one big plane has a second minimum there.
std::vector<Candidate> candidates_of(NormalizedMatches matches, const Models& models, TwoViewModel model) {
  std::vector<SE3> poses;
  if (models.homography) poses = plane_motions(matches, *models.homography);
  if (model == TwoViewModel::kEssential) {
    for (SE3& pose : poses) pose = refine_epipolar(matches, pose, kRefinements);
    for (const SE3& pose : twisted_poses(*models.essential)) poses.push_back(pose);
  }
  std::vector<Candidate> candidates;
  candidates.reserve(poses.size());
  const Residuals plane =
      model == TwoViewModel::kHomography ? transfer_residuals(matches, *models.homography) : Residuals();
  for (const SE3& pose : poses) candidates.push_back(judge(matches, pose, plane));
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& x, const Candidate& y) { return x.cost < y.cost; });
  return candidates;
}

/// The cost that a match adds to a candidate because its point lies behind a camera, in units of sigma^2.
double cost_of_side(const Candidate& candidate, size_t i) {
  return candidate.frontal[i] - std::min(candidate.epipolar[i], kEpipolarCutoff);
}

/// Whether the noise cannot have made `best` cheaper than `rival`. Two kinds of evidence: the side of the
/// camera on which the points of matches lie that fit both poses (both motions of a plane) is nearly free of
/// chance; the epipolar constraint, which about one in ten outliers keeps by luck, is not.
bool decided(const Candidate& best, const Candidate& rival) {
  const double n = static_cast<double>(best.epipolar.size());
  double side = 0;
  int outliers = 0;
  for (size_t i = 0; i < best.epipolar.size(); ++i) {
    const bool fits_best = best.epipolar[i] <= kEpipolarCutoff;
    if (!fits_best) ++outliers;
    if (fits_best && rival.epipolar[i] <= kEpipolarCutoff)
      side += cost_of_side(rival, i) - cost_of_side(best, i);
  }
  const double luck = 3 * kEpipolarCutoff * std::sqrt(2 * 0.1 * outliers);
  // The shares of n, in units of sigma^2 per match, leave room for imperfect calibration.
  return side > std::max(20.0, 0.05 * n) || rival.cost - best.cost > std::max({30.0, 0.1 * n, luck});
}

/// candidates[0] and those that the matches do not decide against.
TwoViewMotions best_motions(const std::vector<Candidate>& candidates, TwoViewModel model) {
  const double n = static_cast<double>(candidates[0].epipolar.size());
  const auto support = [n](const Candidate& c) { return n - c.cost / kEpipolarCutoff; };
  TwoViewMotions motions{model, {candidates[0].pose}};
  for (size_t i = 1; i < candidates.size(); ++i) {
    const bool rival = support(candidates[i]) > kRivalSupport * support(candidates[0]);
    const bool known = std::any_of(motions.b_from_a.begin(), motions.b_from_a.end(),
                                   [&](const SE3& pose) { return same_motion(pose, candidates[i].pose); });
    if (!rival || known) continue;
    motions.b_from_a.push_back(candidates[i].pose);
    motions.decided = motions.decided && decided(candidates[0], candidates[i]);
  }
  return motions;
}

/// Points of the matches under the pose, and how many of those that fit it have one.
struct Structure {
  TwoViewGeometry geometry;
  double good_fraction = 0;  ///< of the matches that fit and are not too near to infinity to tell
};

Structure build_structure(const Camera& camera_a, const Camera& camera_b, std::span<const PixelMatch> matches,
                          std::span<const size_t> index, NormalizedMatches normalized, const SE3& pose,
                          double sigma) {
  const double limit = 16 * sigma * sigma;
  Structure result;
  TwoViewGeometry& geometry = result.geometry;
  geometry.b_from_a = pose;
  geometry.points.assign(matches.size(), Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  geometry.inlier.assign(matches.size(), false);
  const Residuals residuals = epipolar_residuals(normalized, pose);
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  const Eigen::Vector3d center_b = pose.center();
  std::vector<double> parallaxes;
  int fitting = 0;
  for (size_t i = 0; i < index.size(); ++i) {
    if (residuals[i] >= kEpipolarCutoff) continue;
    const NormalizedMatch& m = normalized[i];
    const auto point = triangulate(pose, m.a.normalized(), m.b.normalized());
    if (!point) {
      const double at_infinity = frontal_error(pose, rotation, m, residuals[i]);
      fitting += at_infinity < kEpipolarCutoff ? 0 : 1;
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
    geometry.median_parallax = reorder_to_median(std::span(parallaxes));
  }
  result.good_fraction = fitting > 0 ? static_cast<double>(geometry.inliers) / fitting : 0;
  return result;
}

/// A pixel as (x/z, y/z, 1), and the variance there of a pixel with `sigma`: where the lens compresses the
/// view, a pixel is a larger angle (mean over directions). Not finite for a pixel of a wide lens that looks
/// along the image plane or behind it: no plane image has it.
std::pair<Eigen::Vector3d, double> normalize(const Camera& camera, const Eigen::Vector2d& pixel,
                                             double sigma) {
  constexpr double kMinCosine = 0.05;
  const Eigen::Vector3d ray = camera.unproject(pixel);
  if (ray.z() < kMinCosine) return {Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()), 0};
  const Eigen::Vector3d point = ray / ray.z();
  double pixels_per_unit = camera.focal_length();
  Matrix23d jacobian;
  if (camera.project(point, &jacobian))
    pixels_per_unit = std::sqrt(std::abs(jacobian.leftCols<2>().determinant()));
  return {point, std::pow(sigma / pixels_per_unit, 2)};
}

/// Finite matches as points of the ideal camera; `index` has their places in `matches`.
std::vector<NormalizedMatch> normalize(const Camera& camera_a, const Camera& camera_b,
                                       std::span<const PixelMatch> matches, double sigma,
                                       std::vector<size_t>* index) {
  std::vector<NormalizedMatch> normalized;
  normalized.reserve(matches.size());
  index->reserve(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!matches[i].a.allFinite() || !matches[i].b.allFinite()) continue;
    const auto [a, variance_a] = normalize(camera_a, matches[i].a, sigma);
    const auto [b, variance_b] = normalize(camera_b, matches[i].b, sigma);
    if (!a.allFinite() || !b.allFinite()) continue;
    normalized.push_back({a, b, variance_a, variance_b});
    index->push_back(i);
  }
  return normalized;
}

/// Standard deviation of the matches in units of the assumed one, by the median of what an epipolar geometry
/// leaves.
double measured_sigma(NormalizedMatches matches, const SE3& pose) {
  Residuals residuals = epipolar_residuals(matches, pose);
  return kDeviationPerMedian * std::sqrt(reorder_to_median(std::span(residuals)));
}

/// The camera turned or stood: which of the two, in words.
TwoViewFailure rotation_failure(const Eigen::Matrix3d& rotation, double sigma_angle) {
  const double angle = so3_log(Eigen::Quaterniond(rotation)).norm();
  if (angle < 3 * sigma_angle) return {TwoViewRefusal::kNoParallax, "no parallax: the camera stands still"};
  return {TwoViewRefusal::kRotationOnly,
          text("no parallax: the camera only turned, by %.1f degrees", angle * kDegrees)};
}

}  // namespace

bool same_motion(const SE3& x, const SE3& y) {
  constexpr double kSameRotation = 2 / kDegrees;
  constexpr double kSameDirection = 10 / kDegrees;
  return x.rotation().angularDistance(y.rotation()) < kSameRotation &&
         parallax(Eigen::Vector3d::Zero(), x.translation(), y.translation()) < kSameDirection;
}

tl::expected<TwoViewMotions, TwoViewFailure> find_motions(const Camera& camera_a, const Camera& camera_b,
                                                          std::span<const PixelMatch> matches,
                                                          const TwoViewOptions& options) {
  std::vector<size_t> index;
  std::vector<NormalizedMatch> normalized = normalize(camera_a, camera_b, matches, options.sigma, &index);
  constexpr int kMinimalSample = 5;
  const auto count = static_cast<int>(normalized.size());
  if (count < std::max(options.min_matches, kMinimalSample)) {
    return refuse(TwoViewRefusal::kTooFewMatches,
                  text("%d matches, at least %d needed", count, options.min_matches));
  }
  Models models = fit_models(normalized, options);
  const double noise = models.essential ? std::clamp(measured_sigma(normalized, *models.essential),
                                                     kLeastSigma / options.sigma, 1.0)
                                        : 1.0;
  if (noise < 1) {
    for (NormalizedMatch& m : normalized) {
      m.variance_a *= noise * noise;
      m.variance_b *= noise * noise;
    }
    models = fit_models(normalized, options);
  }
  if (models.rotation_inliers >= options.min_inlier_fraction * count &&
      models.gric_rotation <= std::min(models.gric_essential, models.gric_homography)) {
    return tl::unexpected(rotation_failure(*models.rotation, options.sigma / camera_a.focal_length()));
  }
  if (!models.essential) return refuse(TwoViewRefusal::kNoModel, "no two-view model fits the matches");
  const auto model =
      models.gric_homography < models.gric_essential ? TwoViewModel::kHomography : TwoViewModel::kEssential;
  const auto candidates = candidates_of(normalized, models, model);
  if (candidates.empty())
    return refuse(TwoViewRefusal::kNoModel, "no motion puts the plane in front of both cameras");
  return best_motions(candidates, model);
}

tl::expected<TwoViewGeometry, TwoViewFailure> build_two_view(const Camera& camera_a, const Camera& camera_b,
                                                             std::span<const PixelMatch> matches,
                                                             const SE3& b_from_a,
                                                             const TwoViewCriteria& criteria) {
  std::vector<size_t> index;
  const std::vector<NormalizedMatch> normalized =
      normalize(camera_a, camera_b, matches, criteria.sigma, &index);
  const auto count = static_cast<int>(normalized.size());
  Structure structure =
      build_structure(camera_a, camera_b, matches, index, normalized, b_from_a, criteria.sigma);
  const int fitting = count_below(epipolar_residuals(normalized, b_from_a), kEpipolarCutoff);
  if (fitting < criteria.min_inlier_fraction * count) {
    return refuse(TwoViewRefusal::kNoModel, text("only %d of %d matches fit one motion", fitting, count));
  }
  if (const double angle = structure.geometry.median_parallax; angle < criteria.min_median_parallax) {
    return refuse(TwoViewRefusal::kNoParallax,
                  text("no parallax: %.1f degrees, %.1f needed", angle * kDegrees,
                       criteria.min_median_parallax * kDegrees));
  }
  if (structure.good_fraction < criteria.min_good_fraction) {
    return refuse(TwoViewRefusal::kNoModel, text("only %.0f %% of the matches lie in front of both cameras",
                                                 100 * structure.good_fraction));
  }
  if (direction_uncertainty(normalized, b_from_a) > kMaxDirectionUncertainty) {
    return refuse(TwoViewRefusal::kNoModel, "the matches do not determine the direction of the motion");
  }
  return std::move(structure.geometry);
}

}  // namespace cairn
