// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/plane.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "common/geometry/sampling.h"

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
  MinimalSampler sampler(seed, points.size());
  std::optional<Plane> best;
  double best_cost = inlier_distance * static_cast<double>(points.size());
  for (int trial = 0; trial < trials; ++trial) {
    const auto [i, j, k] = sampler.draw<3>();
    const Eigen::Vector3d normal = (points[j] - points[i]).cross(points[k] - points[i]);
    const double length = normal.norm();
    if (!(length > 1e-12)) continue;
    const Plane plane{normal / length, points[i]};
    double cost = 0;
    for (const auto& p : points) cost += std::min(plane.distance(p), inlier_distance);
    if (cost < best_cost) {
      best_cost = cost;
      best = plane;
    }
  }
  return best;
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
