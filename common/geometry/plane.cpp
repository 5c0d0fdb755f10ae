// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/plane.h"

#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "common/geometry/ransac.h"

namespace cairn {
namespace {

constexpr size_t kMinPoints = 10;
constexpr double kMinInlierFraction = 0.2;

struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  [[nodiscard]] double distance(const Eigen::Vector3d& p) const { return std::abs(normal.dot(p - origin)); }
};

/// Plane of the best triple by the sum of distances cut at `inlier_distance`; nothing if all triples are
/// collinear.
std::optional<Plane> best_triple(std::span<const Eigen::Vector3d> points, double inlier_distance, int trials,
                                 uint64_t seed) {
  RansacOptions options;
  options.population = points.size();
  options.all_outliers = inlier_distance * static_cast<double>(points.size());
  options.most_trials = trials;
  options.stops_early = false;
  options.seed = seed;
  const auto propose = [&](const std::array<size_t, 3>& sample,
                           double limit) -> std::optional<Hypothesis<Plane>> {
    const Eigen::Vector3d& corner = points[sample[0]];
    const Eigen::Vector3d normal = (points[sample[1]] - corner).cross(points[sample[2]] - corner);
    const double length = normal.norm();
    if (!(length > 1e-12)) return std::nullopt;
    const Plane plane{normal / length, corner};
    const double cost = truncated_cost(points, inlier_distance, limit,
                                       [&](const Eigen::Vector3d& p) { return plane.distance(p); });
    if (!(cost < limit)) return std::nullopt;
    return Hypothesis<Plane>{plane, cost};
  };
  return ransac<3, Plane>(options, propose);
}

/// Least-squares plane of the inliers of `plane`, and their number.
std::pair<Plane, int> refit(std::span<const Eigen::Vector3d> points, const Plane& plane,
                            double inlier_distance) {
  int count = 0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) {
    if (plane.distance(p) >= inlier_distance) continue;
    mean += p;
    ++count;
  }
  if (count < 3) return {plane, count};
  mean /= count;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : points) {
    if (plane.distance(p) < inlier_distance) scatter += (p - mean) * (p - mean).transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  return {Plane{solver.eigenvectors().col(0), mean}, count};
}

/// The frame of a plane: Z its normal, X the map's X axis (Y where X is near the normal) laid into the plane.
SE3 frame_of(const Plane& plane) {
  const Eigen::Vector3d& z = plane.normal;
  const Eigen::Vector3d along = std::abs(z.x()) < 0.9 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  const Eigen::Vector3d x = (along - along.dot(z) * z).normalized();
  Eigen::Matrix3d plane_from_map;
  plane_from_map << x.transpose(), z.cross(x).transpose(), z.transpose();
  return {plane_from_map, -plane_from_map * plane.origin};
}

}  // namespace

Result<PlaneFit> fit_dominant_plane(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d& viewpoint,
                                    double inlier_distance, int trials, uint64_t seed) {
  if (points.size() < kMinPoints) return fail(ErrorCode::kDegenerate, "plane: fewer than 10 points");
  constexpr int kRefits = 3;
  const auto triple = best_triple(points, inlier_distance, trials, seed);
  if (!triple) return fail(ErrorCode::kDegenerate, "plane: the points lie on one line or in one place");
  Plane plane = *triple;
  int inliers = 0;
  for (int i = 0; i < kRefits; ++i) std::tie(plane, inliers) = refit(points, plane, inlier_distance);
  if (inliers < kMinInlierFraction * static_cast<double>(points.size())) {
    return fail(ErrorCode::kDegenerate, "plane: no plane holds a fifth of the points");
  }
  if (plane.normal.dot(viewpoint - plane.origin) < 0) plane.normal = -plane.normal;
  return PlaneFit{frame_of(plane), inliers};
}

}  // namespace cairn
