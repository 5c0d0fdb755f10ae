// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

namespace cairn {

/// A point of the map seen at a pixel.
struct PointObservation {
  Eigen::Vector3d point_in_map = Eigen::Vector3d::Zero();
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma = 1.0;  ///< of the measurement [px of level 0]; PTAM: 2^level
};

/// Something on a ray whose distance is known badly or not at all, seen at a pixel. The distance is kept
/// inverted, so that infinity is a number like others (Civera, Davison and Montiel, T-RO 2008).
struct BearingObservation {
  Eigen::Vector3d origin_in_map = Eigen::Vector3d::Zero();    ///< where the ray begins
  Eigen::Vector3d bearing_in_map = Eigen::Vector3d::UnitZ();  ///< unit
  double inverse_depth = 0;                                   ///< along the ray [1 / map unit], >= 0
  double inverse_depth_variance = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma = 1.0;  ///< of the measurement [px of level 0]
};

/// Where the camera is, as known by other means than what it sees.
struct PositionPrior {
  Eigen::Vector3d center_in_map = Eigen::Vector3d::Zero();
  double sigma = 1.0;  ///< in each direction [map unit]
};

/// What a pose may be fitted to besides points. A bearing's distance is marginalised: as far as it is not
/// known, the bearing says nothing along its epipolar line. A bearing whose distance is not known to a fifth
/// says nothing of the position: it holds the rotation and not more.
struct PoseSupplement {
  std::span<const BearingObservation> bearings;
  std::optional<PositionPrior> position;
};

struct PoseOptions {
  int iterations = 10;
  double min_squared_cutoff = 0.25;  ///< floor of Tukey's squared cut-off, in units of sigma
  /// And its ceiling: when most matches are false, their median is no measure.
  double max_squared_cutoff = std::numeric_limits<double>::infinity();
  double prior = 0.0;             ///< added to the diagonal of the normal equations (100 in PTAM r114)
  int fixed_cutoff_after = 1000;  ///< from this iteration on use `late_squared_cutoff`
  double late_squared_cutoff = 16.0;
};

struct PoseEstimate {
  SE3 camera_from_map;
  /// Final Tukey weight of each observation, those of the bearings last; 0 = outlier or behind the camera.
  std::vector<double> weights;
  int inliers = 0;  ///< observations with weight > 0
  double rms = 0;   ///< weighted root mean square reprojection error, in units of sigma
  Matrix6d information = Matrix6d::Zero();     ///< of the observations, without any prior
  Matrix6d covariance = Matrix6d::Identity();  ///< with what is known of the position
};

/// The memory of optimize_pose(), kept from call to call by callers that have no time to allocate. What is in
/// it means nothing to others. One thread.
struct PoseWorkspace {
  /// One observation linearized at the present pose, whitened by its sigma.
  struct Linearized {
    Eigen::Array2d residual;  ///< (projected - measured) / sigma
    std::array<Eigen::Array2d, 6>
        d_residual_d_xi;  ///< x and y side by side; left tangent (translation, rotation)
    double squared = 0;
    bool in_view = false;
  };
  std::vector<Linearized> linearized;
  std::vector<double> squared;  ///< of those in view, in any order
};

/// Robust pose from 2-D/3-D matches by Gauss-Newton on SE3 (PTAM 2007, eq. 6, 8, 9) with analytic Jacobians
/// and Tukey weights re-scaled by the median each iteration. An error when fewer than 4 observations or the
/// normal equations are singular.
[[nodiscard]] Result<PoseEstimate> optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                                                 std::span<const PointObservation> observations,
                                                 const PoseOptions& options = {});
/// The same in memory that is there: it does not allocate where as many observations were before. On an error
/// `estimate` is left with nothing of use.
[[nodiscard]] Status optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                                   std::span<const PointObservation> observations, const PoseOptions& options,
                                   PoseWorkspace* workspace, PoseEstimate* estimate);
/// The same, fitted to `supplement` too; with an empty one the result is equal to the bit. Points and
/// bearings together must be 4 at least.
[[nodiscard]] Status optimize_pose(const Camera& camera, const SE3& camera_from_map_start,
                                   std::span<const PointObservation> observations,
                                   const PoseSupplement& supplement, const PoseOptions& options,
                                   PoseWorkspace* workspace, PoseEstimate* estimate);

/// Unit rays in the camera and points in the map; up to four camera_from_map (P3P, Lambda Twist or
/// equivalent).
[[nodiscard]] std::vector<SE3> solve_p3p(std::span<const Eigen::Vector3d, 3> rays,
                                         std::span<const Eigen::Vector3d, 3> points_in_map);

struct PoseRansacOptions {
  double threshold = 4.0;  ///< px, times the sigma of the observation
  int iterations = 200;
  int min_inliers = 12;
  uint64_t seed = 1;
};
/// P3P inside RANSAC (MSAC score), refined by optimize_pose. An error when no pose has min_inliers.
[[nodiscard]] Result<PoseEstimate> ransac_pose(const Camera& camera,
                                               std::span<const PointObservation> observations,
                                               const PoseRansacOptions& options = {});

}  // namespace cairn
