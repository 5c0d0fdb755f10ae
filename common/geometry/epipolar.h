// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>
#include <vector>

#include "common/geometry/se3.h"

/// Models of two calibrated views and their minimal solvers and refinements. Points are homogeneous image
/// coordinates of the ideal camera, (x/z, y/z, 1). Everything here is a pure function; internal to
/// find_motions() and build_two_view().
namespace cairn {

struct NormalizedMatch {
  Eigen::Vector3d a = Eigen::Vector3d::UnitZ();  ///< (x/z, y/z, 1) in the first view
  Eigen::Vector3d b = Eigen::Vector3d::UnitZ();  ///< in the second
  /// Variance of x/z and of y/z in the first view: (sigma / focal length)^2, more where the lens compresses.
  double variance_a = 1e-6;
  double variance_b = 1e-6;  ///< in the second
};
using NormalizedMatches = std::span<const NormalizedMatch>;

/// Squared errors with more than this are outliers: 99 % of chi^2 with one degree of freedom (epipolar) and
/// two (transfer).
inline constexpr double kEpipolarCutoff = 6.63;
inline constexpr double kTransferCutoff = 9.21;

/// b^T E a = 0; E = [t]x R of b_from_a.
[[nodiscard]] Eigen::Matrix3d essential_of(const SE3& b_from_a);
/// First-order squared distance of a match from the epipolar constraint in units of its sigma (Sampson 1982;
/// Hartley and Zisserman, 11.4.3): chi^2 with one degree of freedom for an inlier.
[[nodiscard]] double sampson_error(const Eigen::Matrix3d& E, const NormalizedMatch& m);
/// Squared transfer error of a homography in units of sigma, mean of both directions: about chi^2 with two
/// degrees.
[[nodiscard]] double transfer_error(const Eigen::Matrix3d& b_from_a, const Eigen::Matrix3d& a_from_b,
                                    const NormalizedMatch& m);

/// Up to ten real essential matrices of five matches (Stewenius, Engels and Nister, ISPRS 2006). Appends to
/// `out`.
void solve_five_point(const std::array<NormalizedMatch, 5>& sample, std::vector<Eigen::Matrix3d>& out);
/// One of the four poses of an essential matrix, |t| = 1 (Hartley and Zisserman, 9.6.2); twisted_poses() has
/// the others.
[[nodiscard]] SE3 pose_of_essential(const Eigen::Matrix3d& E);
/// The four poses that share the essential matrix of `pose`: translation reversed, turned half about the
/// baseline.
[[nodiscard]] std::array<SE3, 4> twisted_poses(const SE3& pose);
/// Levenberg-Marquardt on the five degrees of freedom of b_from_a (|t| = 1), Sampson error, Tukey weights.
[[nodiscard]] SE3 refine_epipolar(NormalizedMatches matches, const SE3& start, int iterations);

/// Standard deviation [rad] of the translation's direction in its least certain way, from the curvature of
/// the Sampson errors; infinity where the matches (on one line, say) leave the pose free.
[[nodiscard]] double direction_uncertainty(NormalizedMatches matches, const SE3& pose);

/// Homography b ~ H a of four matches; false if three are collinear in a view or their orientation is
/// reversed.
[[nodiscard]] bool solve_four_point(const std::array<NormalizedMatch, 4>& sample, Eigen::Matrix3d* H);
/// Re-weighted direct linear transform over all matches (transfer error, Tukey weights).
[[nodiscard]] Eigen::Matrix3d refine_homography(NormalizedMatches matches, Eigen::Matrix3d H, int iterations);

/// H = scale (R + t n^T): pose with |t| = 1 and the unit normal of the plane in frame a, pointing away from
/// the camera.
struct PlaneMotion {
  SE3 b_from_a;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
};
/// The at most four solutions with both cameras on one side of the plane (Faugeras and Lustman 1988), not yet
/// judged by visibility. None if H is a rotation.
[[nodiscard]] std::vector<PlaneMotion> decompose_homography(const Eigen::Matrix3d& H);

/// Rotation b ~ R a nearest to a homography, then Gauss-Newton with Tukey weights on the transfer error.
[[nodiscard]] Eigen::Matrix3d fit_rotation(NormalizedMatches matches, const Eigen::Matrix3d& H,
                                           int iterations);

}  // namespace cairn
