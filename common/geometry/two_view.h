// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

namespace cairn {

struct PixelMatch {
  Eigen::Vector2d a = Eigen::Vector2d::Zero();  ///< pixel in the first image
  Eigen::Vector2d b = Eigen::Vector2d::Zero();  ///< pixel in the second image
};

/// [rad] 0.8 degrees, 7 px at f 500: with less in the median no two views make a map, however sharp they are.
/// A map begun at 0.6 holds, but what is made in it as the camera turns away is off by ten times as much.
constexpr double kLeastMapParallax = 0.8 * 3.14159265358979 / 180;

/// The conditions that a motion of two views must meet.
struct TwoViewCriteria {
  double sigma = 1.0;                                         ///< standard deviation of a match [px]
  double min_median_parallax = 1.2 * 3.14159265358979 / 180;  ///< [rad], over the inliers that triangulate
  double min_inlier_fraction = 0.6;
  /// Least fraction of the inliers that lie in front of both cameras and are reprojected within 4 sigma.
  double min_good_fraction = 0.7;
};

/// The conditions, and how a motion that meets them is searched for.
struct TwoViewOptions : TwoViewCriteria {
  int iterations = 300;  ///< RANSAC trials of each model
  int min_matches = 40;
  uint64_t seed = 1;
};

enum class TwoViewModel : uint8_t { kHomography, kEssential };

struct TwoViewGeometry {
  SE3 b_from_a;                         ///< |translation| = 1
  std::vector<Eigen::Vector3d> points;  ///< in frame a, one per match; NaN where not an inlier
  std::vector<bool> inlier;             ///< per match: fits the model, triangulates in front, reprojects
  int inliers = 0;
  double median_parallax = 0;  ///< [rad]
};

/// Why a pair of views does not make a map; the message says it to a person ("no parallax: 0.2 degrees").
enum class TwoViewRefusal : uint8_t { kTooFewMatches, kNoModel, kNoParallax, kRotationOnly, kAmbiguous };
struct TwoViewFailure {
  TwoViewRefusal reason = TwoViewRefusal::kNoModel;
  std::string message;
};

/// Motions that explain most of the matches of two views, best first: a plane seen from two places near each
/// other has two, and views on the way may tell them apart (adjust_motions).
struct TwoViewMotions {
  TwoViewModel model = TwoViewModel::kEssential;
  std::vector<SE3> b_from_a;  ///< |translation| = 1; at least one
  bool decided = true;        ///< the matches speak for the first, by more than independent noise explains
};

/// Whether two motions of |translation| = 1 are one: within 2 degrees of rotation and 10 of direction.
[[nodiscard]] bool same_motion(const SE3& x, const SE3& y);

/// Relative pose of two calibrated views from matches: homography and essential matrix side by side by MSAC
/// on pixels, compared by Torr's criterion (GRIC, CVPR 1997), homography decomposed after Faugeras and
/// Lustman (1988), essential by SVD; all candidates of the better judged by the side of the camera on which
/// points lie, robustly refined over all inliers by Sampson error. Refuses pure rotation and a standing
/// camera by the parallax that the noise does not explain. Deterministic for a seed. Safe to call from any
/// thread.
[[nodiscard]] tl::expected<TwoViewMotions, TwoViewFailure> find_motions(const Camera& camera_a,
                                                                        const Camera& camera_b,
                                                                        std::span<const PixelMatch> matches,
                                                                        const TwoViewOptions& options = {});

/// Points of the matches under a known motion; refused when too few fit it, or parallax or the matches'
/// spread do not determine them.
[[nodiscard]] tl::expected<TwoViewGeometry, TwoViewFailure> build_two_view(
    const Camera& camera_a, const Camera& camera_b, std::span<const PixelMatch> matches, const SE3& b_from_a,
    const TwoViewCriteria& criteria = {});

}  // namespace cairn
